"""Every set of dense kernels that this processor has gives the factor that NumPy gives, whichever it would choose."""

import os
import subprocess
import sys

import pytest

# A chain of cliques, so that there are fronts of many sizes, among them some that are packed.
SCRIPT = """
import numpy as np
from teamslam.kernel import Analysis, BlockPattern, Factor
rng = np.random.default_rng(3)
sizes = [1, 2, 3, 5, 40, 7, 60, 30, 90, 2, 64, 1, 33]
dofs = np.repeat(np.array([1, 2, 3, 6]), 110)[: sum(sizes) + 1]
rng.shuffle(dofs)
first, second, at = [], [], 0
for size in sizes:
    clique = np.arange(at, at + size + 1)
    a, b = np.meshgrid(clique, clique)
    first.append(a.ravel()), second.append(b.ravel())
    at += size
pattern = BlockPattern.from_pairs(dofs[: at + 1], np.concatenate(first), np.concatenate(second))
H = np.zeros((pattern.scalars, pattern.scalars))
start = pattern.scalar_start
for f, s in zip(first, second):
    clique = np.unique(f)
    unknowns = np.concatenate([np.arange(start[v], start[v + 1]) for v in clique])
    J = rng.normal(size=(len(unknowns) + 3, len(unknowns)))
    H[np.ix_(unknowns, unknowns)] += J.T @ J / len(unknowns) + np.eye(len(unknowns))
values = np.concatenate([
    H[start[r] : start[r + 1], start[c] : start[c + 1]].T.ravel()
    for c in range(len(pattern.dofs))
    for r in pattern.row[pattern.column_start[c] : pattern.column_start[c + 1]]
])
for ordering in ("minimum_degree", "natural"):
    factor = Factor(Analysis(pattern, ordering))
    factor.factor(values)
    B = rng.normal(size=(pattern.scalars, 11))
    np.testing.assert_allclose(factor.solve(B), np.linalg.solve(H, B), rtol=0, atol=1e-10)
    np.testing.assert_allclose(factor.solve(B[:, 0]), np.linalg.solve(H, B[:, 0]), rtol=0, atol=1e-10)
    inverse = np.linalg.inv(H)
    for v, block in enumerate(factor.diagonal_inverse()):
        own = slice(start[v], start[v + 1])
        np.testing.assert_allclose(block, inverse[own, own], rtol=0, atol=1e-10)
"""


@pytest.mark.parametrize("name", ["baseline", "avx2", "avx512"])
def test_against_dense(name):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], env=os.environ | {"TEAMSLAM_DENSE": name}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr

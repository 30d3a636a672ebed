"""What is tried between robots takes time in proportion to the team, however dear a try is."""

from dataclasses import replace

import numpy as np
import pytest

from teamslam.joining.place.frameworks import Assembly, Truss
from teamslam.joining.place.trusses import SOLVED
from teamslam.trust.causes.between import TRUSSES_A_ROBOT, mistakes_between
from worlds import team


def test_where_each_try_looks_for_trusses_few_are_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots that only heard how far away the others are, and heard wrong: no slip explains it, and the search ends."""
    robots, rng = 3, np.random.default_rng(0)
    log = team("2d", robots=robots, poses=5, landmarks=0, robot_model="range", every=1)
    heard = [
        replace(t, values=rng.uniform(1.0, 9.0, t.values.shape)) if t.source == "robots" else t for t in log.tables
    ]
    solved: list[Truss] = []
    solve = Truss.assemblies

    def counted(truss: Truss) -> list[Assembly]:
        solved.append(truss)
        return solve(truss)

    monkeypatch.setattr(Truss, "assemblies", counted)
    assert mistakes_between(log.with_tables(t for t in heard if len(t)), [1, 2, 3]) == []
    one_join = SOLVED * robots  # as it is, and the last try, which may be begun with one truss left
    assert 0 < len(solved) <= TRUSSES_A_ROBOT * robots + 2 * one_join

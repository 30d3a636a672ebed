"""A part of a map that hangs on a tag whose corners fit two poses swings to where it costs less."""

import numpy as np
import pytest

from hinged_walls import HINGES, hardly_tied, three_walls
from teamslam.frontend.tags.hinges import swung
from teamslam.frontend.tags.whole_poses import hypotheses
from teamslam.joining.build.build import build_with_solution
from teamslam.model import Dataset, Kind, Table, Values, landmark_key, pack
from teamslam.solver import System, optimise
from thinned import thinned


def folded(values, sightings, wall_of, hinge, last):
    """All walls after `last` swung about a hinge, which `last` sees at its other pose."""
    key = int(landmark_key(HINGES[hinge]))
    rows = sightings.select((sightings.keys[:, 1] == key) & [wall_of[int(k)] == last for k in sightings.keys[:, 0]])
    eye = values.poses_of(rows.keys[:1, 0], 3)
    known = values.poses_of(rows.keys[:1, 1], 3)
    both = eye @ hypotheses(rows)[0][0]
    other = both[[int(np.argmax(np.linalg.norm(known.rotation - both.rotation, axis=(1, 2))))]]
    behind = [k for k, wall in wall_of.items() if wall > last] + [key]
    behind += [int(landmark_key(n)) for k, n in enumerate(HINGES) if k > hinge]
    keys = np.array(sorted(behind))
    return values.update(Values.of({Kind.POSE3: (keys, other @ known.inverse() @ values.poses_of(keys, 3))}))


def optima(seed, hinges):
    """The tables of three walls, the optimum beside the truth, and that from where walls are folded about hinges."""
    sightings, truth, wall_of = three_walls(seed)
    tables = [hardly_tied(truth), sightings]
    system = System(truth.layout, tables=tables, fixed=sightings.keys[:1, 0])
    best = optimise(system, truth)
    bent = best.values
    for hinge in hinges:
        bent = folded(bent, sightings, wall_of, hinge, hinge)
    return tables, best, optimise(system, bent)


@pytest.mark.parametrize("seed", thinned(4, range(8)))
@pytest.mark.parametrize("hinges", [(0,), (1,), (0, 1)])
def test_walls_that_hang_on_tags_with_the_wrong_pose_swing_back(seed, hinges):
    """A submap costs no more than the optimum beside the truth, wherever its search begins."""
    tables, best, worst = optima(seed, hinges)
    _, found = build_with_solution(Dataset({1: 3}, tuple(tables)), near=worst.values)
    assert found.cost < best.cost + 1e-3


def test_walls_do_not_swing_back_by_themselves():
    """Least squares alone stay folded in most of these rooms: an optimum that costs more."""
    both = [optima(seed, (1,))[1:] for seed in range(6)]
    assert sum(worst.converged and worst.cost > best.cost + 1.0 for best, worst in both) > 3


@pytest.mark.parametrize("seed", range(2))
def test_what_swings_changes_no_row_within_a_part(seed):
    """Only sightings of one tag from one wall, and steps from it to others, cost something else."""
    sightings, truth, wall_of = three_walls(seed)
    best = optimise(System(truth.layout, tables=[sightings], fixed=sightings.keys[:1, 0]), truth).values
    ways = swung(best, [sightings], int(sightings.keys[0, 0]))
    assert ways
    for other in ways:
        change = np.sum(sightings.whitened(other) ** 2, -1) - np.sum(sightings.whitened(best) ** 2, -1)
        rows = np.flatnonzero(np.abs(change) > 1e-6)
        assert len(np.unique(sightings.keys[rows, 1])) == 1
        assert len({wall_of[int(key)] for key in sightings.keys[rows, 0]}) == 1


@pytest.mark.parametrize("seed", range(2))
def test_what_odometry_ties_does_not_swing(seed):
    """Steps known to a centimetre and a hundredth of a radian say how all walls stand."""
    sightings, truth, _ = three_walls(seed)
    loose = hardly_tied(truth)
    ends = [truth.poses_of(keys, 3) for keys in loose.keys.T]
    firm = Table(1, "odometry", "relative_pose", 3, loose.keys, pack(ends[0].between(ends[1])),
                 loose.whitening * 300.0, loose.ids)  # fmt: skip
    best = optimise(System(truth.layout, tables=[firm, sightings], fixed=sightings.keys[:1, 0]), truth).values
    assert not swung(best, [firm, sightings], int(sightings.keys[0, 0]))

"""Bad submaps are refused with the reason, and the rest is joined."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from teamslam.errors import InputError
from teamslam.io.submaps.arrays import submap_to_bytes, write_submap
from teamslam.joining import build, join, split
from teamslam.model import Kind, Names, Submap, Table, Values, pose_key
from teamslam.team import SubmapSet, admit
from teamslam.wire.messages import canonical
from worlds import team


def submaps_of(**options: int) -> list[Submap]:
    log = team("2d", robots=3, poses=6, landmarks=4, sees=0.8, **options)
    return [build(piece) for piece in split(log, poses_per_piece=100)]


GOOD = submaps_of()


def indefinite(submap: Submap) -> Submap:
    weight = np.ones(submap.dof)
    weight[3] = -1.0
    return replace(submap, information=sp.csr_array(submap.information.multiply(np.outer(weight, weight)) * -1.0))


def not_finite(submap: Submap) -> Submap:
    state = submap.values.state.copy()
    state[0] = np.nan
    return replace(submap, values=Values(submap.values.layout, state))


def without_base(submap: Submap) -> Submap:
    return replace(submap, base=999_999)  # a landmark's key: nothing that a map could be seen from


def spatial_landmarks(submap: Submap) -> Submap:
    """The same landmarks as points in space."""
    values = submap.values
    marks = values.layout.keys_of(Kind.POINT2)
    points = np.concatenate([values.table(Kind.POINT2), np.zeros((len(marks), 1))], 1)
    others = {kind: (keys, data) for kind, keys, data in values.parts() if kind != Kind.POINT2}
    lifted = Values.of(others | {Kind.POINT3: (marks, points)})
    return replace(submap, values=lifted, information=sp.csr_array(sp.eye_array(lifted.layout.dof)))


def renamed_landmark(submap: Submap) -> Submap:
    return replace(submap, names=Names({}, {0: "not the oak"}, 1.0))


def raw_sighting(**flaw: object) -> Callable[[Submap], Submap]:
    """With a range that its robot's base pose measured to another robot, under a robust loss, and one flaw in it."""

    def spoil(submap: Submap) -> Submap:
        (robot,) = submap.robots
        keys = np.array([[submap.base, pose_key(robot % 3 + 1, 0)]])
        sound = Table(robot, "odometry", "range", 2, keys, np.ones((1, 1)), np.eye(1)[None], np.array([0]))
        return replace(submap, raw=(replace(sound, **flaw),))

    return spoil


def turned_landmark(submap: Submap) -> Submap:
    """A raw pose of what the submap holds as a point."""
    keys = np.array([[submap.base, submap.landmark_keys[0]]])
    identity = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]])
    seen = raw_sighting(model="relative_pose", keys=keys, values=identity, whitening=np.eye(3)[None])
    return seen(submap)


SHEAR = np.array([[0.0, 0.0, 1.0, 1.0, 0.0, 1.0]])

BAD = {
    "indefinite": (indefinite, "not positive definite"),
    "not finite": (not_finite, "not finite"),
    "no base frame": (without_base, "neither a robot's pose nor the world"),
    "another dimension": (spatial_landmarks, "another dimension"),
    "another clock": (lambda s: replace(s, names=Names(tick_s=1e-6)), "tick"),
    "raw noise of nothing": (raw_sighting(whitening=np.zeros((1, 1, 1))), "says nothing"),
    "raw noise beyond numbers": (raw_sighting(whitening=np.full((1, 1, 1), 1e200)), "not finite, or beyond"),
    "raw rotation that is none": (
        raw_sighting(model="relative_pose", values=SHEAR, whitening=np.eye(3)[None]),
        "not orthonormal",
    ),
    "raw direction that is none": (
        raw_sighting(model="bearing", dim=3, values=np.full((1, 3), 1.0), whitening=np.eye(2)[None]),
        "no unit vector",
    ),
    "raw sighting by a landmark": (raw_sighting(keys=np.array([[0, pose_key(1, 0)]])), "not taken from its own poses"),
    "raw sighting by another": (raw_sighting(robot=9), "not taken from its own poses"),
    "raw sighting of itself": (raw_sighting(robot=1, keys=np.full((1, 2), pose_key(1, 0))), "sees itself"),
    "raw sighting by nobody": (raw_sighting(robot=-3), "numbered from 1"),
    "raw row that is none": (raw_sighting(ids=np.array([-1])), "counted from 0"),
    "raw row of nobody's log": (raw_sighting(ids=np.array([7000])), "counted twice unseen"),
    "raw turn of a point": (turned_landmark, "holds as a point"),
}


@pytest.mark.parametrize("flaw", BAD)
@pytest.mark.parametrize("place", range(3))
def test_one_bad_submap_is_refused_and_the_rest_is_joined(flaw: str, place: int) -> None:
    spoil, reason = BAD[flaw]
    candidates = [spoil(s) if n == place else s for n, s in enumerate(GOOD)]
    found = admit(candidates)
    assert [r.name for r in found.refused] == [GOOD[place].id]
    assert reason in found.refused[0].reason
    rest = [s for n, s in enumerate(GOOD) if n != place]
    assert [s.id for s in found.good] == [s.id for s in rest]
    assert canonical(join(found.good).map) == canonical(join(rest).map)


@pytest.mark.parametrize("place", range(3))
def test_a_sound_raw_sighting_is_admitted(place: int) -> None:
    """What the flaws above are put into has none itself."""
    found = admit([raw_sighting()(s) if n == place else s for n, s in enumerate(GOOD)])
    assert not found.refused
    assert join(found.good).converged


def test_files_that_are_damaged_of_another_version_or_none_are_refused(tmp_path: Path) -> None:
    for number, submap in enumerate(GOOD):
        write_submap(submap, tmp_path / f"{number}.submap")
    data = bytearray(submap_to_bytes(GOOD[0]))
    damaged, newer = bytearray(data), bytearray(data)
    damaged[len(data) // 2] ^= 1
    newer[8] = 77
    for name, content in (("damaged", damaged), ("newer", newer), ("cut", data[:-9]), ("none", b"hello")):
        (tmp_path / f"{name}.submap").write_bytes(bytes(content))
    found = admit([tmp_path, tmp_path / "absent.submap"])
    assert [s.id for s in found.good] == [s.id for s in GOOD]
    reasons = {Path(r.name).stem: r.reason for r in found.refused}
    assert set(reasons) == {"damaged", "newer", "cut", "none", "absent"}
    assert "digest does not fit" in reasons["damaged"]
    assert "version 77" in reasons["newer"]
    assert "cut off" in reasons["cut"]
    assert "no such file" in reasons["absent"]


def test_conflicting_ids_are_both_refused() -> None:
    other = replace(GOOD[0], cost=GOOD[0].cost + 1.0)
    found = admit([*GOOD, other])
    assert [s.id for s in found.good] == [s.id for s in GOOD[1:]]
    assert [r.name for r in found.refused] == [GOOD[0].id]
    assert "higher version" in found.refused[0].reason


def test_a_submap_twice_and_an_older_version_are_no_faults() -> None:
    newer = replace(GOOD[0], version=3)
    found = admit([*GOOD, GOOD[1], newer])
    assert not found.refused
    assert sorted(s.version for s in found.good) == [0, 0, 3]


def test_names_that_contradict_are_refused() -> None:
    called = [replace(s, names=Names({}, {0: "the oak"}, 1.0)) for s in GOOD]
    found = admit([called[0], renamed_landmark(called[1]), called[2]])
    assert [r.name for r in found.refused] == [GOOD[1].id]
    assert "one name for the whole team" in found.refused[0].reason


def test_of_submaps_that_exclude_each_other_the_worst_goes_whatever_the_order() -> None:
    """One submap that took rows of both others is refused, not the two."""
    greedy = replace(GOOD[0], id="greedy", sources=GOOD[1].sources.merge(GOOD[2].sources))
    for candidates in ([greedy, *GOOD[1:]], [*GOOD[1:], greedy]):
        found = admit(candidates)
        assert [r.name for r in found.refused] == ["greedy"]
        assert "count twice" in found.refused[0].reason


def test_what_is_left_out_excludes_nobody() -> None:
    """A submap that took rows of the others would be believed, were these refused; left out, it has no say."""
    greedy = replace(GOOD[0], id="greedy", sources=GOOD[1].sources.merge(GOOD[2].sources))
    found = admit([greedy, *GOOD], without=["greedy", "1"])
    assert found.left_out == tuple(sorted(["greedy", GOOD[0].id]))
    assert not found.refused
    assert [s.id for s in found.good] == [s.id for s in GOOD[1:]]
    with pytest.raises(InputError, match=r"no robot is called '4'; there are: 1, 1/0, 2"):
        admit(GOOD, without=["4"])


def test_a_set_joins_what_is_good() -> None:
    known = SubmapSet.of(*GOOD, replace(GOOD[2], id="again"))
    assert len(known.submaps) == 3
    assert len(known.admission.refused) == 1
    assert len(known.join().components) == 1

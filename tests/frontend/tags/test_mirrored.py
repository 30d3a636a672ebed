"""A tag whose corners fit two poses stands at the right one in the map of a robot that saw it often."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tag_walks
import tagged_room
import teamslam as ts
from teamslam.frontend.tags.mirrored import turned
from teamslam.frontend.tags.whole_poses import hypotheses
from teamslam.geometry import Pose, concatenate
from teamslam.joining import cost_of
from teamslam.model import Dataset, Kind, Values, landmark_key, pose_key, robot_of
from teamslam.solver import System, optimise
from thinned import thinned


@pytest.fixture(scope="module", params=thinned(2, [1, 7, 9, 14]))
def log(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Rooms in which a way that is bent at first turns a tag."""
    folder = tmp_path_factory.mktemp("room") / "team"
    return ts.read(tagged_room.write(tagged_room.make(request.param, 24.0, 2.0), folder, seed=request.param))


def test_no_robot_makes_less_of_its_own_sightings_than_the_team_does(log: Dataset) -> None:
    """A submap is the least that its measurements cost: they cost no less anywhere else, and so not at the map of full
    least squares; and joined they cost what they cost there, but for what Gaussians leave out."""
    submaps = [ts.build(piece) for piece in ts.split(log)]
    full, joined = ts.full(log).map, ts.join(submaps).map
    for submap in submaps:
        held = [t for t in log.tables if t.robot == int(robot_of(submap.base)) and t.source != "robots"]
        assert submap.cost <= cost_of(full, held).cost
    assert cost_of(joined, log.tables).cost < 1.01 * cost_of(full, log.tables).cost


def test_a_tag_that_is_turned_is_turned_back(log: Dataset) -> None:
    """Each in its turn; an optimum in which none is comes back as nothing."""
    piece = next(iter(ts.split(log)))
    submap = ts.build(piece)
    values = submap.all_values
    tables = [t for t in piece.tables if t.source == "landmarks"]
    assert turned(values, tables) is None
    for key in submap.landmark_keys.tolist():
        rows = tables[0].select(tables[0].keys[:, 1] == key)
        poses, costs = hypotheses(rows)
        if not np.isfinite(costs[0, 1]):
            continue
        wrong = values.poses_of(rows.keys[:1, 0], 3) @ poses[:1, 1]
        bent = values.update(Values.of({Kind.POSE3: (np.array([key]), wrong)}))
        back = turned(bent, tables)
        assert back is not None
        here, there = (of.poses_of(np.array([key]), 3) for of in (values, back))
        assert np.linalg.norm(here.rotation - there.rotation) < 0.5


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_tag_seen_often_from_afar_is_turned_back_from_where_it_fits_best_the_other_way_round(seed: int) -> None:
    """Of a hundred sightings from 8 m each tells its pose badly, and all of them where it stands: a pose of one of them
    costs more than the optimum that is the wrong one."""
    rng = np.random.default_rng(seed)
    tag = Pose(Rotation.from_rotvec([0.0, 0.4, 0.0]).as_matrix(), np.array([8.0, 0.0, 0.0]))
    tag = Pose(np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) @ tag.rotation, tag.translation)
    eyes = Pose(np.tile(np.eye(3), (100, 1, 1)), rng.uniform(-0.6, 0.6, (100, 3)))
    keys = [(int(pose_key(1, k)), int(landmark_key(7))) for k in range(100)]
    rows = tag_walks.corners_of(keys, np.array([tag_walks.corners_seen(rng, eye, tag) for eye in eyes]))
    true = Values.of({Kind.POSE3: (np.array([*(k for k, _ in keys), keys[0][1]]), concatenate([eyes, tag[None]]))})
    mark = np.array([keys[0][1]])
    system = System(true.layout, tables=[rows], fixed=np.array([k for k, _ in keys]))
    optima = [optimise(system, true)]
    for eye, two in zip(eyes[:10], hypotheses(rows)[0][:10], strict=True):
        optima += [optimise(system, true.update(Values.of({Kind.POSE3: (mark, eye[None] @ one[None])}))) for one in two]
    best, worst = min(optima, key=lambda s: s.cost), max(optima, key=lambda s: s.cost)
    assert worst.cost > best.cost + 1.0
    assert turned(best.values, [rows]) is None
    back = turned(worst.values, [rows])
    assert back is not None and optimise(system, back).cost < best.cost + 0.1

"""What a team answers by name: against the map itself, a dense inverse, draws from its Gaussian, and the CSV files."""

import csv
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import teamslam as ts
from teamslam.answers import Relative
from teamslam.errors import MissingExtraError, ModelError
from teamslam.model import Names, Values, pose_key
from teamslam.results import read_run, write_run
from thinned import thinned
from worlds import mixed_team, team

NAMES = Names({1: "red", 2: "blue", 3: "green"}, {0: "door", 1: "lamp", 2: "tree"}, 0.5)


def named(world: str = "2d", **options: object) -> ts.Dataset:
    return replace(team(world, **options), names=NAMES)  # type: ignore[arg-type]


@pytest.fixture(scope="module", params=["2d", "planar", "3d"])
def run(request: pytest.FixtureRequest):
    return ts.run(named(request.param))


@pytest.fixture(scope="module")
def flat():
    return ts.run(named())


def test_a_trajectory_is_the_map_of_one_robot_the_base_included(run) -> None:
    for number, name in enumerate(("red", "blue", "green"), 1):
        found, keys = run.trajectory(name), run.map.trajectory_keys(number)
        poses = run.map.all_values.poses_of(keys, found.poses.dim)
        np.testing.assert_allclose(found.stamps_s, 0.5 * np.arange(12))
        np.testing.assert_array_equal(found.positions, poses.translation)
        np.testing.assert_array_equal(found.rotations, poses.rotation)
        np.testing.assert_array_equal(found.headings, poses.heading)
        known = ts.Covariances.of_map(run.map)
        for key, block in zip(keys.tolist(), found.covariances, strict=True):
            assert block == pytest.approx(known.of(key) if key != run.map.base else 0.0)
    assert not run.trajectory("red").covariances[0].any() and run.trajectory("blue").covariances[0].any()


def test_landmarks_are_those_of_the_map_one_by_one_and_together(run) -> None:
    for mark in run.landmarks:
        assert run.landmark(mark.name).position == pytest.approx(mark.position)
        assert run.landmarks[mark.name].covariance == pytest.approx(mark.covariance)
    assert run.landmark_names == run.landmarks.names == ("door", "lamp", "tree", "3", "4", "5")
    assert run.landmark("3").position == pytest.approx(run.landmark(3).position)
    assert "door" in run.landmarks and "gate" not in run.landmarks and len(run.landmarks) == 6


def test_a_region_holds_as_many_draws_as_it_says(flat) -> None:
    mark = flat.landmark("door")
    radii, axes = mark.region(0.8)
    draws = np.random.default_rng(0).multivariate_normal(np.zeros(2), mark.covariance, 20_000)
    inside = np.sum((draws @ axes / radii) ** 2, -1) <= 1.0
    assert inside.mean() == pytest.approx(0.8, abs=0.01)


def test_a_joint_covariance_is_the_block_of_the_dense_inverse(run) -> None:
    layout = run.map.values.layout
    dense = np.linalg.inv(run.map.information.toarray())
    found = run.covariance("door", "blue@2", "lamp")
    keys = np.array([0, int(pose_key(2, 4)), 1])
    at = layout.unknowns(keys)
    np.testing.assert_allclose(np.asarray(found), dense[np.ix_(at, at)], rtol=1e-6, atol=1e-12)
    assert found.things == ("landmark door", "robot blue at 2.000 s", "landmark lamp")
    np.testing.assert_allclose(found.block(0, 2), dense[np.ix_(layout.unknowns(keys[:1]), layout.unknowns(keys[2:]))],
                               rtol=1e-6, atol=1e-12)  # fmt: skip
    assert np.diag(found.correlations) == pytest.approx(1.0) and len(found.labels) == len(found.matrix)


def test_the_base_is_known_exactly_whoever_is_asked(run) -> None:
    joint = run.covariance("red@first", "door")
    dof = joint.sizes[0]
    assert not joint.matrix[:dof].any() and joint.matrix[dof:, dof:] == pytest.approx(run.landmark("door").covariance)
    seen = run.relative("door", seen_from="red@first")
    assert seen.position == pytest.approx(run.landmark("door").position)
    assert seen.covariance == pytest.approx(run.landmark("door").covariance)


@pytest.mark.parametrize("target", thinned(2, ["door", "green@3", "red@first"]))
def test_a_relative_covariance_is_that_of_draws(run, target: str) -> None:
    """Of many maps drawn from the map's own Gaussian, each asked where the target is."""
    found, seer = run.relative(target, seen_from="blue@2"), int(pose_key(2, 4))
    keys = {"door": 0, "green@3": int(pose_key(3, 6)), "red@first": int(pose_key(1, 0))}
    small = 1e-3
    draws = ts.Covariances.of_map(run.map).draws(np.random.default_rng(1).standard_normal((run.map.dof, 4000)))
    base = run.map.all_values
    errors = []
    for draw in draws.T:
        moved = base.update(run.map.values.retract(small * draw))
        errors.append(_relative(moved, seer, keys[target], found) / small)
    spread = np.cov(np.array(errors).T)
    assert spread == pytest.approx(found.covariance, abs=0.08 * float(np.trace(found.covariance)))
    assert found.distance == pytest.approx(float(np.linalg.norm(found.position)))
    if target != "red@first":
        lengths = np.linalg.norm(found.position + small * np.array(errors)[:, : len(found.position)], axis=1)
        assert lengths.std() / small == pytest.approx(found.distance_sigma, rel=0.05)


def _relative(values: Values, seer: int, seen: int, found: Relative) -> np.ndarray:
    """Where a target is seen, less where it was found."""
    dim = len(found.position)
    eye = values.pose(seer).lift(dim)
    if found.pose is not None:
        return eye.between(values.pose(seen).lift(dim)).minus(found.pose)
    return np.asarray(eye.unact(values.positions(np.array(seen), dim)) - found.position)


def test_residuals_of_a_run_a_join_and_full_are_those_of_the_verdict(run) -> None:
    log, table = run.dataset, run.residuals()
    rows = [row for part in run.verdict.parts for row in part.rows]
    assert len(table) == sum(map(len, rows)) == sum(map(len, log.tables))
    for part, row in zip(table.parts, rows, strict=True):
        np.testing.assert_allclose(part.whitened, row.whitened, atol=1e-9)
    joined = ts.join(ts.build(piece) for piece in ts.split(log))
    again = joined.residuals(log)
    np.testing.assert_allclose(again.columns()["size"], table.columns()["size"], atol=1e-9)
    with pytest.raises(ModelError, match="hand over the log"):
        joined.residuals()
    assert len(ts.full(log).residuals()) == len(table)


def test_the_worst_residuals_are_the_largest_and_name_the_row(flat) -> None:
    log = flat.dataset
    seen = next(t for t in log.tables if t.source == "landmarks" and t.robot == 2)
    values = seen.values.copy()
    values[7] += 3.0
    spoilt = ts.run(log.with_tables([replace(seen, values=values) if t is seen else t for t in log.tables]))
    worst, second, third = spoilt.residuals().worst(3)
    assert (worst.robot, worst.source, worst.row) == ("blue", "landmarks", int(seen.ids[7]))
    sizes = spoilt.residuals().columns()["size"]
    np.testing.assert_allclose([worst.size, second.size, third.size], np.sort(sizes)[:-4:-1])
    assert "robot blue, landmarks row 7" in str(worst) and "sigma" in str(worst)


def test_columns_are_those_of_the_csv_files_and_a_run_read_back_answers_alike(run, tmp_path: Path) -> None:
    write_run(run, tmp_path / "run", figures=False)
    back = read_run(tmp_path / "run")
    for file, columns in (
        ("landmarks.csv", [run.landmarks.columns(), back.landmarks.columns()]),
        ("trajectories.csv", [_together(run), _together(back)]),
        ("residuals.csv", [run.residuals().columns(), back.residuals().columns()]),
    ):
        with (tmp_path / "run" / file).open(newline="") as lines:
            rows = list(csv.DictReader(lines))
        for found in columns:
            assert set(rows[0]) <= {*found, "component", "robot"}
            assert len(rows) == len(next(iter(found.values())))
            for name in set(rows[0]) & set(found):
                written = [row[name] for row in rows]
                if found[name].dtype == object:
                    assert written == found[name].tolist()
                else:
                    np.testing.assert_allclose(
                        [float(cell or "nan") for cell in written], found[name].astype(float), rtol=1e-3, atol=1e-6
                    )
    assert back.covariance("door", "blue@2").matrix == pytest.approx(run.covariance("door", "blue@2").matrix)


def _together(run) -> dict[str, np.ndarray]:
    columns = [run.trajectory(robot).columns() for robot in run.robots]
    return {name: np.concatenate([part[name] for part in columns]) for name in columns[0]}


def test_dataframes_hold_the_columns(flat) -> None:
    pandas = pytest.importorskip("pandas")
    for record in (flat.trajectory("red"), flat.landmarks, flat.residuals()):
        frame = record.to_dataframe()
        assert isinstance(frame, pandas.DataFrame) and list(frame) == list(record.columns())
        for name, column in record.columns().items():
            assert len(frame) == len(column)
            np.testing.assert_array_equal(frame[name].to_numpy(), column)
    joint = flat.covariance("door", "lamp")
    assert joint.to_dataframe().loc["landmark door x_m", "landmark lamp y_m"] == joint.matrix[0, 3]


def test_without_pandas_the_columns_are_there_and_the_error_says_so(flat, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingExtraError, match=r"teamslam\[pandas\].*columns\(\)"):
        flat.landmarks.to_dataframe()
    assert len(flat.landmarks.columns()["x_m"]) == 6


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda t: t.landmark("dor"), "did you mean 'door'"),
        (lambda t: t.landmark("zzz"), "there are door, lamp, tree, 3, 4, 5"),
        (lambda t: t.landmark(None), "by its name, such as 'door'; found nothing"),
        (lambda t: t.landmarks["dor"], "did you mean 'door'"),
        (lambda t: t.trajectory("rde"), "did you mean 'red'"),
        (lambda t: t.trajectory("door"), "no robot here is called 'door'"),
        (lambda t: t.trajectory(["red"]), "found a list"),
        (lambda t: t.covariance("red"), "'red' is a robot, which has many poses; ask for one, such as 'red@first'"),
        (lambda t: t.covariance("blue@2.2"), r"no pose at 2.2; beside it are those at 2.000 and 2.500 \('blue@~2.2'"),
        (lambda t: t.covariance("blue@99"), "beside it are those at 5.500"),
        (lambda t: t.covariance("blue@noon"), "'noon' is no stamp"),
        (lambda t: t.covariance(), "name what the covariance is asked of"),
        (lambda t: t.covariance(2.5), "found a float"),
        (lambda t: t.relative("door", seen_from="lamp"), "seen from a pose, such as .*landmark lamp is a place alone"),
        (lambda t: t.relative("blue@1", seen_from="blue@1"), "two different things"),
        (lambda t: t.landmark("door", component=2), "there is 1 map, counted from 1; found component 2"),
        (lambda t: t.covariances[0].of("dor"), "did you mean 'door'"),
        (lambda t: ts.plot(t.dataset), r"expected a map .* found a Dataset; .*plot\(ts.run\(log\)\)"),
        (lambda t: ts.run(3), "expected a log .* found an int"),
        (lambda t: ts.simulate("2d", robot=5), "no option 'robot'; did you mean 'robots'"),
        (lambda t: ts.simulate(7), "found an int"),
    ],
)
def test_what_is_not_there_is_told_with_what_is(flat, ask, words: str) -> None:
    with pytest.raises(ts.TeamslamError, match=words):
        ask(flat)


def test_two_maps_that_could_not_be_joined_are_asked_one_by_one() -> None:
    log = named(robots=2, every=99)
    apart = log.with_tables(t for t in log.tables if t.source != "robots" and (t.robot == 1 or t.source == "odometry"))
    joined = ts.full(apart)
    assert len(joined.maps) == 2 and joined.robots == ("red", "blue")
    assert joined.trajectory("red").component == 1 and joined.trajectory("blue").component == 2
    assert "blue" in joined.trajectory("blue").frame and "maps that could not be joined" in repr(joined)
    with pytest.raises(ModelError, match="in different maps, which could not be joined"):
        joined.covariance("door", "blue@2")
    with pytest.raises(ModelError, match="no landmark here"):
        joined.landmark("door", component=2)
    assert len(joined.residuals()) == sum(map(len, apart.tables))


def test_robots_of_plane_and_space_answer_in_their_own_dimension() -> None:
    joined = ts.full(mixed_team())
    assert joined.trajectory(1).poses.dim == 2 and joined.trajectory(2).poses.dim == 3
    assert joined.relative("2@3", seen_from="1@2").pose.dim == 3


def test_run_takes_the_path_of_a_log_and_simulate_takes_options(tmp_path: Path) -> None:
    log = ts.simulate("2d", robots=2, poses=6, seed=4)
    ts.write(log, tmp_path / "log")
    assert ts.run(str(tmp_path / "log")).robots == ts.run(tmp_path / "log").robots == ("1", "2")
    assert len(ts.simulate("2d", robots=5).robots) == 5


def test_a_plot_of_whatever_has_a_map(flat) -> None:
    from matplotlib.figure import Figure

    parts = [ts.build(piece) for piece in ts.split(flat.dataset)]
    for thing in (flat, flat.joined, ts.join(parts), parts[0]):
        assert isinstance(ts.plot(thing, title="A team"), Figure)

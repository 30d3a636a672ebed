"""Joining by a tree: one level is the join of all at once, more levels differ to second order; kills are survived."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perishing import join_with_an_end, piece_after_a_death, piece_of, piece_of_death, small_log
from teamslam.errors import InputError, ModelError, SolveError
from teamslam.geometry import Array
from teamslam.joining import Joined, build, join, split
from teamslam.model import WORLD, Dataset, Table, Values, is_pose, robot_of
from teamslam.pipeline import run
from teamslam.scale import Cluster, Processes, TreeMap, gather, join_in_tree
from teamslam.scale.sharing import Sharing, by_sharing
from teamslam.scale.tree import Part, settled
from teamslam.solver import Covariances, Options
from teamslam.wire.pieces import write_pieces
from worlds import WORLDS, measure, team


class Here:
    """Workers that are threads of this process: as good, and there at once."""

    def open(self) -> Executor:
        return ThreadPoolExecutor(2)


def both(log: Dataset, folder: Path, fan: int, poses_per_piece: int = 6) -> tuple[TreeMap, Joined]:
    """The team joined by a tree, and at once."""
    pieces = split(log, poses_per_piece=poses_per_piece)
    files = write_pieces(pieces, folder / "pieces")
    return join_in_tree(files, folder / "join", workers=Here(), fan=fan), join(map(build, pieces))


def shifts(values: Values, joined: Joined) -> Array:
    """How far each variable is from the join's, in its own sigmas."""
    reference = joined.map.values
    apart = values.only(reference.layout.keys).minus(reference)
    starts = reference.layout.dof_start
    blocks = Covariances.of_map(joined.map).all
    parts = [apart[starts[n] : starts[n + 1]] for n in range(len(blocks))]
    return np.array([np.sqrt(d @ np.linalg.solve(c, d)) for d, c in zip(parts, blocks, strict=True)])


# --- laws -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("world", WORLDS)
def test_one_level_is_the_join_of_all_at_once(world: str, tmp_path: Path) -> None:
    tree, joined = both(team(world), tmp_path, fan=6)
    values = tree.values()
    assert np.array_equal(values.layout.keys, joined.map.all_values.layout.keys)
    assert shifts(values, joined).max() < 1e-6
    root = tree.joined.map
    assert root.rows - root.dof == joined.map.rows - joined.map.dof
    assert root.chi2 == pytest.approx(joined.map.chi2, rel=1e-9)


@pytest.mark.parametrize("world", WORLDS)
def test_levels_differ_to_second_order(world: str, tmp_path: Path) -> None:
    apart = []
    for sigma in (0.02, 0.005):
        log = team(world, sigma=sigma, sigma_odometry=sigma)
        tree, joined = both(log, tmp_path / str(sigma), fan=2)
        apart.append(shifts(tree.values(), joined).max())
    # Second order in metres is first order in sigmas: a quarter of the noise, about a quarter of the shift.
    assert 0.0 < apart[0] < 1.0
    assert apart[1] < 0.4 * apart[0]


def test_gathered_the_tree_is_the_join(tmp_path: Path) -> None:
    tree, joined = both(team("planar"), tmp_path, fan=2)
    whole = gather(tree)
    assert shifts(whole.map.values, joined).max() < 1e-5
    assert whole.converged and whole.components[0].members == joined.components[0].members
    difference = (whole.map.information - joined.map.information).toarray()
    assert np.abs(difference).max() < 1e-4 * np.abs(joined.map.information.toarray()).max()
    assert whole.map.sources == joined.map.sources
    assert whole.map.rows == joined.map.rows


@pytest.mark.parametrize("fan", [2, 6])
def test_raw_sightings_of_robots_find_their_other_half(fan: int, tmp_path: Path) -> None:
    tree, joined = both(team("2d", robot_model="range_bearing"), tmp_path, fan)
    whole = gather(tree)
    assert shifts(whole.map.values, joined).max() < 1e-5
    assert whole.map.rows == joined.map.rows
    assert not whole.map.raw


def test_the_root_holds_what_is_shared_and_nothing_else(tmp_path: Path) -> None:
    log = team("2d", robots=4, poses=20)
    pieces = split(log, poses_per_piece=6)
    tree = join_in_tree(write_pieces(pieces, tmp_path / "p"), tmp_path / "j", workers=Here())
    named = [build(piece).keys for piece in pieces]
    shared = Sharing.of(named).keys
    bases = np.array([piece.pose_keys[piece.tables[0].robot][0] for piece in pieces])
    assert np.isin(tree.joined.map.keys, np.union1d(shared, bases)).all()


def test_strangers_are_components_with_the_reason(tmp_path: Path) -> None:
    log = team("2d", robots=2, landmarks=8, every=100)
    first, second = (log.of_robot(robot) for robot in (1, 2))
    apart = [t for t in first.tables if t.source != "robots"]
    theirs = [t for t in second.tables if t.source == "odometry"]
    strangers = log.with_tables([*apart, *theirs])
    tree, joined = both(strangers, tmp_path, fan=2)
    assert [c.members for c in tree.joined.components] == [c.members for c in joined.components]
    assert len(tree.joined.components) == 2 and tree.joined.reasons
    for number, component in enumerate(joined.components):
        values = tree.values(number)
        assert np.array_equal(values.layout.keys, component.map.all_values.layout.keys)
        assert len(gather(tree).components[number].map.values) == len(component.map.values)


def test_a_team_of_one(tmp_path: Path) -> None:
    tree, joined = both(team("3d", robots=1), tmp_path, fan=2, poses_per_piece=100)
    assert shifts(tree.values(), joined).max() < 1e-6


def test_a_group_that_finds_no_optimum_goes_on_unjoined(tmp_path: Path) -> None:
    maps = {Part(tmp_path / str(n), tmp_path): build(p) for n, p in enumerate(split(team("planar")))}
    of_id = {submap.id: part for part, submap in maps.items()}
    stopped = join(maps.values(), options=Options(max_iterations=1))
    assert not stopped.converged
    assert settled(stopped, maps, of_id, root=False) == [(submap, (part,)) for part, submap in maps.items()]
    assert settled(stopped, maps, of_id, root=True) == [(stopped.map, tuple(maps))]


def blind(log: Dataset, robot: int) -> Dataset:
    """The log with one robot whose odometry says nothing of the heading, and who measured nothing else."""

    def headless(table: Table) -> Table:
        return replace(table, whitening=np.diag([1.0, 1.0, 0.0]) @ table.whitening) if table.robot == robot else table

    return log.with_tables(headless(t) for t in log.tables if t.robot != robot or t.source == "odometry")


def test_a_piece_that_cannot_be_built_is_left_out_and_the_rest_is_mapped() -> None:
    log = blind(team("2d", robots=3, poses=6, landmarks=4, sees=1.0), robot=2)
    by_tree, at_once = run(log, workers=Here()), run(log)
    for joined in (by_tree.joined, at_once.joined):
        (lost,) = joined.left_out
        assert lost.kind == "piece" and "robot 2" in lost.what and lost.count == 5
        assert "is not determined" in lost.reason
        assert joined.components[0].members == ("1/0", "3/0")
    assert shifts(by_tree.map.values, at_once.joined).max() < 1e-6


def test_where_nothing_can_be_built_the_reason_is_told(tmp_path: Path) -> None:
    pieces = split(blind(team("2d", robots=1, poses=4), robot=1))
    with pytest.raises(SolveError, match="not determined"):
        join_in_tree(write_pieces(pieces, tmp_path / "pieces"), tmp_path / "join", workers=Here())


def test_trajectories_a_file_a_robot(tmp_path: Path) -> None:
    tree, joined = both(team("2d"), tmp_path, fan=2)
    files = tree.write_trajectories(tmp_path / "ways")
    assert sorted(f.name for f in files) == ["1.tum", "2.tum", "3.tum"]
    assert all(len(f.read_text().splitlines()) == 12 for f in files)
    keys = tree.values(robot=2).layout.keys
    assert is_pose(keys).all() and (robot_of(keys) == 2).all()
    assert np.array_equal(tree.landmarks().layout.keys, joined.map.landmark_keys)


# --- on from where it stopped -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("every", [1, 4])
def test_a_tree_in_the_world_s_frame(every: int, tmp_path: Path) -> None:
    """Also where the first groups hold one position each, and where several are in that frame before they meet."""
    log = team("2d", robots=2, poses=16, sigma=0.01, sigma_odometry=0.01)
    rng = np.random.default_rng(3)
    fixes = [
        measure(robot, "gps", "position", 2, keys[1::every, None], 0.01, log.truth, rng)
        for robot, keys in log.pose_keys.items()
    ]
    tree, joined = both(log.with_tables([*log.tables, *fixes]), tmp_path, fan=2, poses_per_piece=4)
    assert tree.joined.map.base == joined.map.base == WORLD
    assert set(tree.values().layout.keys) == set(joined.map.values.layout.keys)
    assert shifts(tree.values(), joined).max() < 1.0
    assert shifts(gather(tree).map.values, joined).max() < 1e-5


def test_what_is_finished_is_not_made_again(tmp_path: Path) -> None:
    files = write_pieces(split(team("2d"), poses_per_piece=6), tmp_path / "p")
    first = join_in_tree(files, tmp_path / "j", workers=Here(), fan=2)
    made = {f: f.stat().st_mtime_ns for f in (tmp_path / "j").rglob("*") if f.is_file()}
    again = join_in_tree(files, tmp_path / "j", workers=Here(), fan=2)
    after = {f: f.stat().st_mtime_ns for f in (tmp_path / "j").rglob("*") if f.is_file()}
    root = {f for (f,) in zip([e[0] for e in first.estimates], strict=True)}  # the root's places are written each time
    assert {f: t for f, t in after.items() if f not in root} == {f: t for f, t in made.items() if f not in root}
    assert np.array_equal(first.values().state, again.values().state)


def test_a_lost_or_damaged_file_is_made_again(tmp_path: Path) -> None:
    files = write_pieces(split(team("2d"), poses_per_piece=6), tmp_path / "p")
    first = join_in_tree(files, tmp_path / "j", workers=Here(), fan=2)
    contents = {f: f.read_bytes() for f in (tmp_path / "j").rglob("*.submap")}
    whole = first.values().state
    for place, file in enumerate(sorted(contents)):
        file.unlink() if place % 2 else file.write_bytes(contents[file][:-7])
    for file in (tmp_path / "j" / "estimates").iterdir():
        file.unlink()
    again = join_in_tree(files, tmp_path / "j", workers=Here(), fan=2)
    assert {f: f.read_bytes() for f in (tmp_path / "j").rglob("*.submap")} == contents
    assert np.array_equal(again.values().state, whole)


def test_a_changed_piece_changes_what_depends_on_it(tmp_path: Path) -> None:
    for seed in (1, 2):
        log = small_log(seed)
        files = write_pieces(split(log), tmp_path / f"p{seed}")
        tree = join_in_tree(files, tmp_path / "j", workers=Here())
        assert shifts(tree.values(), join(map(build, split(log)))).max() < 1e-6


# --- workers that die -------------------------------------------------------------------------------------------------

kills = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")


def runs(pid: int) -> bool:
    """True while a process runs; one that has ended may still be listed, as a zombie."""
    try:
        os.kill(pid, 0)
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except (OSError, ValueError):
        return False


@kills
def test_a_killed_process_is_survived(tmp_path: Path) -> None:
    jobs = [partial(piece_after_a_death, 1, 3, tmp_path / "died"), partial(piece_of, 2, 3)]
    heard: list[tuple[str, int, int]] = []
    tree = join_in_tree(jobs, tmp_path / "j", workers=Processes(2), progress=lambda *said: heard.append(said))
    assert (tmp_path / "died").exists()
    assert shifts(tree.values(), join(map(build, split(small_log(3))))).max() < 1e-6
    assert ("building submaps", 2, 2) in heard


@kills
def test_a_run_that_was_killed_goes_on_from_what_is_finished(tmp_path: Path) -> None:
    folder, marker = tmp_path / "j", tmp_path / "died"
    script = "import sys, pathlib, perishing; perishing.join_with_an_end(*map(pathlib.Path, sys.argv[1:]))"
    here = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    ended = subprocess.run([sys.executable, "-c", script, folder, marker], env=here)
    assert ended.returncode == -signal.SIGKILL
    (finished,) = (folder / "submaps").glob("*.submap")
    written = finished.stat().st_mtime_ns
    worker = int(marker.read_text())
    while runs(worker):  # it leaves when it sees that the run is gone
        time.sleep(0.05)
    tree = join_with_an_end(folder, marker)
    assert finished.stat().st_mtime_ns == written
    assert shifts(tree.values(), join(map(build, split(small_log(3))))).max() < 1e-6


@kills
def test_processes_that_die_again_and_again_are_given_up(tmp_path: Path) -> None:
    with pytest.raises(SolveError, match="workers died 3 times in a row, with 1 of 1 tasks left"):
        join_in_tree([partial(piece_of_death, 1, 3)], tmp_path, workers=Processes(1))


@kills
def test_a_killed_worker_of_a_cluster_is_survived(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    jobs = [partial(piece_after_a_death, 1, 3, tmp_path / "died"), partial(piece_of, 2, 3)]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50, protocol="tcp"
    ) as cluster:
        tree = join_in_tree(jobs, tmp_path / "j", workers=Cluster(cluster.scheduler_address))
    assert (tmp_path / "died").exists()
    assert shifts(tree.values(), join(map(build, split(small_log(3))))).max() < 1e-6


# --- refused ----------------------------------------------------------------------------------------------------------


def test_what_cannot_be_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="the set of submaps is empty"):
        join_in_tree([], tmp_path, workers=Here())
    with pytest.raises(InputError, match="at least 2"):
        join_in_tree([tmp_path], tmp_path, workers=Here(), fan=1)
    with pytest.raises(InputError, match="at least one worker"):
        Processes(0)
    twice = [partial(piece_of, 1, 3), partial(piece_of, 1, 4)]
    with pytest.raises(ModelError, match="both called"):
        join_in_tree(twice, tmp_path, workers=Here())


def test_what_would_count_twice_is_refused_wherever_in_the_tree_it_meets(tmp_path: Path) -> None:
    log = team("2d", robots=3)
    whole, halves = split(log), split(log.of_robot(1), poses_per_piece=6)
    files = write_pieces([*whole, halves[1]], tmp_path / "p")
    with pytest.raises(ModelError, match="they would count twice"):
        join_in_tree(files, tmp_path / "j", workers=Here(), fan=2)


def test_no_cluster_at_an_address() -> None:
    pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    with pytest.raises(InputError, match="no dask scheduler"):
        Cluster("nowhere").open()


# --- what is shared ---------------------------------------------------------------------------------------------------


@given(st.lists(st.frozensets(st.integers(0, 12), min_size=1), min_size=1, max_size=9), st.data())
def test_across_is_what_others_name_too(sets: list[frozenset[int]], data: st.DataObject) -> None:
    sharing = Sharing.of([np.array(sorted(s)) for s in sets])
    start = data.draw(st.integers(0, len(sets) - 1))
    stop = data.draw(st.integers(start + 1, len(sets)))
    inside = frozenset().union(*sets[start:stop])
    outside = frozenset().union(*sets[:start], *sets[stop:])
    assert inside & frozenset(sharing.across(start, stop).tolist()) == inside & outside


@given(st.lists(st.frozensets(st.integers(0, 12), min_size=1), min_size=1, max_size=12))
def test_the_order_holds_every_leaf_once(sets: list[frozenset[int]]) -> None:
    assert sorted(by_sharing([np.array(sorted(s)) for s in sets])) == list(range(len(sets)))


def test_a_chain_in_disorder_is_put_in_a_row() -> None:
    names = np.random.default_rng(0).permutation(16)
    named = [np.array([n, n + 1]) for n in names.tolist()]
    row = names[by_sharing(named)].reshape(-1, 4)
    assert all(block.max() - block.min() == 3 for block in row)  # each four are neighbours

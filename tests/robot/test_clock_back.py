"""A robot's clock goes back: stamps come twice, of two times, and no row may tie one to the other."""

from dataclasses import replace

import numpy as np

from teamslam.joining import build, join
from teamslam.live import replayed
from teamslam.model import Dataset, Table, index_of, is_pose, pose_key, robot_of
from teamslam.robot import Options, Robot
from worlds import team

LOG = team("2d", robots=1, poses=60, landmarks=9, sees=0.6)
POSES = LOG.pose_keys[1]
STEP = int(index_of(POSES[1]) - index_of(POSES[0]))
TURN, BACK = 30, 10  # the clock goes back by so many poses after this one


def set_back(table: Table) -> Table:
    """A table's rows as they are told after the turn, by the clock that went back."""
    own = is_pose(table.keys) & (robot_of(table.keys) == 1)
    return replace(table, keys=np.where(own, table.keys - BACK * STEP, table.keys))


def arrivals(log: Dataset) -> list[list[Table]]:
    """The rows as they come."""
    found, turn = [], int(index_of(POSES[TURN]))
    for _, tables in replayed(log, 1):
        own = [index_of(t.keys[robot_of(t.keys) == 1]) for t in tables]
        if all(at.max() <= turn for at in own):
            found.append(tables)
        elif all(at.min() > turn for at in own):  # no odometry reaches over the turn
            found.append([set_back(t) for t in tables])
        else:
            found.append([set_back(t) for t, at in zip(tables, own, strict=True) if at.min() > turn])
    return found


def test_no_row_ties_the_time_before_to_the_time_after() -> None:
    """What is taken is what came before the turn, and what was taken altogether from after the last stamp of before."""
    robot = Robot.of(LOG, 1, Options(poses_per_piece=12))
    for tables in arrivals(LOG):
        robot = robot.step(tables)
        robot = robot.close() if robot.due else robot
    last = int(pose_key(1, int(index_of(POSES[TURN]))))
    came = [table for tables in arrivals(LOG) for table in tables]
    rows = sum(len(table) for table in came)
    assert robot.twice == index_of(POSES[TURN]) and robot.counts.taken + robot.counts.late == rows
    for piece in robot.finish().closed:
        for batch in piece.rows:
            own = batch.table.keys[robot_of(batch.table.keys) == 1]
            assert (own <= last).all() or (own > last).all()
    pieces = [piece for n in range(len(robot.finish().closed)) for piece in robot.finish().pieces(n)]
    made = join(build(piece) for piece in pieces)
    assert made.map.cost < 1.5 * (made.map.rows - made.map.dof)
    assert 0 < robot.counts.late < rows


def test_what_comes_again_late_is_no_turn_of_the_clock() -> None:
    robot = Robot.of(LOG, 1, Options(poses_per_piece=12))
    told = [tables for _, tables in replayed(LOG, 1)]
    for n, tables in enumerate(told):
        robot = robot.step(tables)
        if n == 40:
            for again in told[10:20]:
                robot = robot.step([replace(table, ids=table.ids + 10_000) for table in again])
    assert robot.twice < 0 and robot.counts.taken == sum(len(t) for tables in told for t in tables)

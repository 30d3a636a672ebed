"""Landmarks without names: all names of a log taken away, and the map made without them beside that with them.

    python benchmarks/unnamed.py LOG ...

`of the landmark that most are of`: of the sightings that were kept, the share that is with most of its own. Errors are
of the robots' positions after one alignment of the team. Seconds are of processor time, for the association alone.
"""

import argparse
import os
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import teamslam
from teamslam.metrics import score
from teamslam.model import Dataset, is_landmark
from teamslam.model.keys import unnamed_key
from teamslam.pipeline import Result, run
from teamslam.trust.associate import associate


def nameless(log: Dataset) -> Dataset:
    """The log without the names of its landmarks."""
    tables = []
    for table in log.tables:
        bare = is_landmark(table.keys[:, -1])
        keys = table.keys.copy()
        keys[bare, -1] = unnamed_key(table.robot, table.ids[bare])
        tables.append(replace(table, keys=keys))
    return log.with_tables(tables)


def told(log: Dataset, found: Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Of every sighting that was kept the true landmark, and the one that it was given."""
    known = {(t.robot, t.source, n): k for t in log.tables for n, k in zip(t.ids.tolist(), t.keys[:, -1], strict=True)}
    pairs = [
        (known[table.robot, table.source, number], key)
        for table in found.tables
        for number, key in zip(table.ids.tolist(), table.keys[:, -1].tolist(), strict=True)
        if is_landmark(key)
    ]
    return tuple(np.array(column) for column in zip(*pairs, strict=True))  # type: ignore[return-value]


def error(result: Result) -> float:
    """Of the robots' positions [m], in the map with most poses."""
    assert result.truth is not None
    found = score(max(result.maps, key=lambda map: map.dof), result.truth).accuracy
    return float("nan") if found is None else float(found.robot_position_rmse_m or np.nan)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", type=Path, nargs="+")
    columns = ("log", "landmarks", "sightings kept", "of the landmark that most are of", "maps", "RMSE, with names",
               "ratio", "seconds")  # fmt: skip
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|", flush=True)
    for path in parser.parse_args().logs:
        log = teamslam.read(path)
        assert isinstance(log, Dataset)
        began = time.process_time()
        found = associate(nameless(log)).dataset
        spent = time.process_time() - began
        true, given = told(log, found)
        right = sum(np.unique(true[given == key], return_counts=True)[1].max() for key in np.unique(given))
        every = sum(int(is_landmark(table.keys[:, -1]).sum()) for table in log.tables)
        without, best = run(nameless(log)), error(run(log))
        print(
            f"| {path.name} | {len(np.unique(given))} of {len(log.landmark_keys)} | {len(true) / every:.0%} "
            f"| {right / len(true):.2%} | {len(without.maps)} | {error(without):.3f} m, {best:.3f} m "
            f"| {error(without) / best:.2f} | {spent:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()

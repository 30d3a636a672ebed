"""What a page tells in tables: robots and stamps, links, residuals, landmarks, what was left out, what it took."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np

from teamslam.answers.residuals import LANDMARK, Residuals
from teamslam.geometry import Array
from teamslam.model import Values, index_of, robot_of
from teamslam.report import Table
from teamslam.results.estimated import estimated_table
from teamslam.results.page_trust import trust_tables
from teamslam.results.record import Record
from teamslam.viz import shape_of

WORST = 15  # rows told one by one
MOST_LANDMARKS = 20  # by their residuals
MOST_LINKS = 40  # pairs of robots
MOST_TOLD = 1000  # landmarks, one by one

Report = Mapping[str, Any]


def tables_of(record: Record, truths: Sequence[Values | None], start_s: float) -> Iterator[Table]:
    """The tables of a page, in its order, where there is something to say. `truths` are in the frames of the maps."""
    found = [
        *trust_tables(record.report),
        _robots(record, truths, start_s),
        _links(record),
        _sensors(record),
        _by_landmark(record),
        _worst(record, start_s),
        _calibration(record.report),
        estimated_table(record.report),
        _left_out(record.report),
        _parts(record.report),
        _landmarks(record, truths),
        _stages(record.report),
    ]
    yield from (table for table in found if table.rows)


def _robots(record: Record, truths: Sequence[Values | None], start_s: float) -> Table:
    """Each robot's stamps and way: what synchronisation is judged by."""
    rows = []
    for number, (submap, truth) in enumerate(zip(record.maps, truths, strict=True), start=1):
        for robot in submap.robots_in_it:
            keys = submap.trajectory_keys(robot)
            stamps, places = submap.names.stamps_s(keys) - start_s, submap.all_values.positions(keys, 3)
            steps = np.diff(stamps)
            error = None
            if truth is not None and (known := truth.layout.contains(keys)).any():
                away = places[known] - truth.positions(keys[known], 3)
                error = float(np.sqrt(np.mean(np.sum(away**2, -1))))
            rows.append([
                submap.names.robot(robot), str(number), f"{len(keys):,}", f"{stamps[0]:.1f}", f"{stamps[-1]:.1f}",
                f"{np.median(steps):.3g}" if len(steps) else "-", f"{steps.max():.3g}" if len(steps) else "-",
                f"{np.linalg.norm(np.diff(places, axis=0), axis=-1).sum():.2f}",
                "-" if error is None else f"{error:.3f}",
            ])  # fmt: skip
    unit = "pose" if record.maps[0].names.counts else "s"
    columns = ("robot", "part", "poses", f"first [{unit}]", f"last [{unit}]", f"median step [{unit}]",
               f"longest gap [{unit}]", "way [m]", "position RMSE [m]")  # fmt: skip
    note = "" if unit == "pose" else f"Stamps since {start_s:.3f} s, on the clock of the log."
    return Table("Robots", columns, rows, note)


def _links(record: Record) -> Table:
    """What ties each two robots together: sightings of each other, and landmarks that both saw."""
    names = record.maps[0].names
    seen: dict[tuple[str, str], int] = {}
    for a, b in robot_of(record.sightings).tolist():
        pair = tuple(sorted((names.robot(a), names.robot(b))))
        seen[pair[0], pair[1]] = seen.get((pair[0], pair[1]), 0) + int(a != b)
    marks: dict[str, set[str]] = {}
    for rows in record.rows:
        of = marks.setdefault(rows.robot, set())
        of |= {word for word in rows.targets if word.startswith(LANDMARK)}
    robots = sorted(marks)
    pairs = {(a, b): len(marks[a] & marks[b]) for n, a in enumerate(robots) for b in robots[n + 1 :]}
    every = sorted({pair for pair, count in (seen | pairs).items() if count or seen.get(pair)})
    every.sort(key=lambda pair: -(seen.get(pair, 0) + pairs.get(pair, 0)))
    table = [[a, b, f"{seen.get((a, b), 0):,}", str(pairs.get((a, b), 0))] for a, b in every[:MOST_LINKS] if a != b]
    note = f"The {MOST_LINKS} strongest of {len(every)}." if len(every) > MOST_LINKS else ""
    return Table("Links between robots", ("robot", "robot", "sightings of each other", "landmarks in common"), table,
                 note)  # fmt: skip


def _sensors(record: Record) -> Table:
    """Residuals by sensor and robot."""
    rows = []
    for found in record.rows:
        size = found.size
        if len(size):
            median, high = np.quantile(size, [0.5, 0.95])
            lost, weighed = float(np.mean(size > 3.0)), _rms(size, found.weight)
            rows.append([found.source, found.robot, f"{len(size):,}", f"{median:.2f}", f"{weighed:.2f}",
                         f"{high:.2f}", f"{lost:.2%}", f"{size.max():.1f}"])  # fmt: skip
    rows.sort(key=lambda row: (row[0], row[1]))
    columns = ("sensor", "robot", "rows", "median", "RMS", "95 % below", "above 3", "worst")
    return Table(
        "Residuals by sensor and robot", columns, rows, "In standard deviations: 1 where the noise is as stated."
    )


def _by_landmark(record: Record) -> Table:
    """Residuals by landmark, the largest first."""
    sizes: dict[str, list[Array]] = {}
    seers: dict[str, set[str]] = {}
    for found in record.rows:
        if not any(word.startswith(LANDMARK) for word in found.targets):
            continue
        by_target = np.argsort(found.target, kind="stable")
        ends = np.searchsorted(found.target[by_target], np.arange(len(found.targets) + 1))
        both = np.stack([found.size, found.weight])[:, by_target]
        for word, start, stop in zip(found.targets, ends[:-1].tolist(), ends[1:].tolist(), strict=True):
            if word.startswith(LANDMARK):
                sizes.setdefault(word, []).append(both[:, start:stop])
                seers.setdefault(word, set()).add(found.robot)
    pooled = {word: np.concatenate(parts, -1) for word, parts in sizes.items()}
    order = sorted((word for word in pooled if pooled[word].size), key=lambda word: -_rms(*pooled[word]))
    rows = [
        [word.removeprefix(LANDMARK), f"{pooled[word].shape[-1]:,}", str(len(seers[word])),
         f"{np.median(pooled[word][0]):.2f}", f"{np.quantile(pooled[word][0], 0.95):.2f}",
         f"{_rms(*pooled[word]):.2f}"]
        for word in order[:MOST_LANDMARKS]
    ]  # fmt: skip
    note = f"The {MOST_LANDMARKS} largest of {len(order)}." if len(order) > MOST_LANDMARKS else ""
    columns = ("landmark", "rows", "robots", "median", "95 % below", "RMS", "")
    return Table("Residuals by landmark", columns, rows, note, bars=5)


def _worst(record: Record, start_s: float) -> Table:
    """The rows that leave most."""
    found = [(float(part.size[n]), part, n) for part in record.rows for n in _largest(part).tolist()]
    found.sort(key=lambda entry: -entry[0])
    rows = [
        [f"{size:.2f}", part.robot, part.source, part.targets[part.target[n]],
         "-" if np.isnan(part.stamp_s[n]) else f"{part.stamp_s[n] - start_s:.2f}", str(part.row[n]),
         f"{part.weight[n]:.2f}"]
        for size, part, n in found[:WORST]
    ]  # fmt: skip
    columns = ("size [sigma]", "robot", "sensor", "seen", "time", "row of the log", "weight")
    return Table("The worst rows", columns, rows, "All rows are in residuals.csv.")


def _largest(part: Residuals) -> np.ndarray:
    count = min(WORST, len(part.size))
    return np.argpartition(-part.size, count - 1)[:count] if count else np.zeros(0, np.int64)


def _calibration(report: Report) -> Table:
    """What was wrong with the sensors, clocks among it, as far as the data show it."""
    rows = [
        [e["robot"], e["source"], _term(e), f"{e['value']:.3g}", f"{e['sigma']:.2g}", f"{e['prior']:.2g}", e["unit"]]
        for e in (report.get("calibration") or {}).get("systematic", [])
    ]
    columns = ("robot", "sensor", "systematic error", "value", "sigma", "before", "unit")
    return Table("Calibration", columns, rows, "Before: the standard deviation it was given before the data spoke.")


def _term(error: dict[str, Any]) -> str:
    """Which error it is, and of which landmark, where it is of one."""
    return f"{error['term']}: {error['landmark']}" if "landmark" in error else str(error["term"])


def _left_out(report: Report) -> Table:
    """What went in and is in no map, and what was not read."""
    rows = [[lost["what"], f"{lost['rows']:,}", lost["reason"]] for lost in report.get("left_out", [])]
    rows += [["not read", f"{d['count']:,}", d["reason"]] for d in report.get("dropped_reasons", [])]
    rows += [[f"refused: {r['name']}", "", r["reason"]] for r in report.get("refused", [])]
    rows += [[f"without: {name}", "", "as asked"] for name in report.get("without", [])]
    return Table("Dropped and left out", ("what", "rows", "reason"), rows)


def _parts(report: Report) -> Table:
    """What each map is made of, what it costs, and how exact it is."""
    rows = []
    for number, part in enumerate(report["parts"], start=1):
        exact = part.get("exactness") or {}
        rows.append([
            str(number), f"{part['poses']:,}", f"{part['landmarks']:,}", str(part["submaps"]), f"{part['dof']:,}",
            _figure(part["cost"]), str(part["iterations"]), _figure(exact.get("rounds")), _figure(exact.get("bytes")),
            _figure(exact.get("relative_cost_gap")), _figure(exact.get("max_shift_sigma")),
        ])  # fmt: skip
    columns = ("part", "poses", "landmarks", "submaps", "degrees of freedom", "cost", "steps", "rounds", "bytes",
               "relative gap of cost", "largest shift [sigma]")  # fmt: skip
    note = "Gap and shift: from the full least squares on the same measurements. Bytes: what robots sent in the rounds."
    return Table("Exactness and bytes", columns, rows, note)


def _landmarks(record: Record, truths: Sequence[Values | None]) -> Table:
    """Every landmark, with the longest radius of its 95 % region."""
    rows: list[list[str]] = []
    for number, submap in enumerate(record.maps, start=1):
        keys, values, truth = submap.landmark_keys, submap.all_values, truths[number - 1]
        blocks = record.covariances[number - 1].blocks(keys)
        dims = 2 + values.layout.kinds[values.layout.index(keys)] % 2
        places = values.positions(keys, 3)
        off = np.full(len(keys), np.nan)
        if truth is not None and (known := truth.layout.contains(keys)).any():
            off[known] = np.linalg.norm(places[known] - truth.positions(keys[known], 3), axis=-1)
        cells = zip(keys.tolist(), places, dims.tolist(), blocks, off.tolist(), strict=True)
        for key, place, dim, block, error in islice(cells, MOST_TOLD - len(rows)):
            radius = float(shape_of(block[:dim, :dim])[0][-1])
            rows.append([submap.names.landmark(int(index_of(key))), str(number), *(f"{x:.3f}" for x in place[:dim]),
                         *["-"] * (3 - dim), f"{radius:.4f}", "-" if np.isnan(error) else f"{error:.3f}"])  # fmt: skip
    total = sum(len(submap.landmark_keys) for submap in record.maps)
    note = f"The first {len(rows):,} of {total:,}; all are in landmarks.csv." if total > len(rows) else ""
    columns = ("landmark", "part", "x [m]", "y [m]", "z [m]", "95 % within [m]", "from its truth [m]")
    return Table("Landmarks", columns, rows, note, folded=True)


def _stages(report: Report) -> Table:
    """What it took, and with what."""
    rows = [[stage, f"{seconds:.3f} s"] for stage, seconds in report.get("stages_s", {}).items()]
    rows += [[name, str(number)] for name, number in report.get("versions", {}).items()]
    return Table("Times and versions", ("", ""), rows, folded=True)


def _rms(size: Array, weight: Array) -> float:
    """The root of the mean square, each row as its loss weighs it."""
    return float(np.sqrt(np.mean(weight * size**2)))


def _figure(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:,}" if isinstance(value, int) else f"{value:.4g}"

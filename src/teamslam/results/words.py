"""A report in words, for the screen. Every sentence is true wherever it is printed."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from teamslam.results.estimated import estimated_lines

if TYPE_CHECKING:
    from teamslam.results.record import Record

Report = Mapping[str, Any]
Rows = list[tuple[str, str]]

UNSEEN = 1e-12  # of a cost, or of one sigma squared: what rounding hides
FAR = 1.0  # [sigma] from full least squares: a join that is farther is told the way there


DONE = {
    "landmark": "each of its places is a landmark",
    "place": "what it sees is a landmark of its own",
    "name": "these sightings are of that landmark now",
    "mount": "it is estimated with the map, and to be stated as the `sensor` of these rows",
    "turning": "its turns are estimated with the map",
}


def outcome(report: Report) -> Rows:
    """What a run came to, as names and values."""
    parts = report["parts"]
    return [
        ("status", report["status"]),
        *_components(report),
        *(("left out", _lost(lost)) for lost in report.get("left_out", [])),
        *(("remark", sentence) for sentence in report.get("remarks", [])),
        *(("ambiguous", sentence) for sentence in report["ambiguities"]),
        *(("put right", f"{cause['sentence']}: {DONE[cause['kind']]}") for cause in report.get("apart", ())),
        *(("put right", sentence) for sentence in (report.get("calibration") or {}).get("sentences", ())),
        *(("estimated", line) for line in estimated_lines(report)),
        *(("truth", _late(late)) for late in report.get("truth_late", ())),
        *_rejected(report.get("rejected")),
        *_suspicions(report.get("suspicions")),
        *_fit(report["fit"]),
        *_weak(report.get("weak", [])),
        *_cost(report),
        *([("exactness", exactness(report))] if report["method"] == "join" else []),
        ("went in", counted(report["robots"], "robot", report["poses"], "pose", report["landmarks"], "landmark")),
        *_unchecked(report.get("seen_once", 0)),
        *(("read", note) for note in report["notes"]),
        *_dropped(report),
        *_scores(report),
        *([] if len(parts) == 1 else _parts(parts)),
        ("took", f"{report['seconds']:.2f} s without reading and writing; {_steps(report)}"),
    ]


def _components(report: Report) -> Rows:
    if report["components"] == 1:
        return []
    said = f"{report['components']}: the team could not be joined into one map"
    frames = {part["frame"] for part in report["parts"]}
    alike = f", though all are in {frames.pop()}" if len(frames) == 1 else ""
    return [("components", said + alike), *(("", reason) for reason in report["reasons"])]


def _unchecked(count: int) -> Rows:
    """Landmarks whose place, and how well it is known, nothing confirms."""
    if not count:
        return []
    return [
        ("unchecked", f"{counted(count, 'landmark')} seen only once: nothing checks {'it' if count == 1 else 'them'}")
    ]


def _late(late: Report) -> str:
    """How late a truth was."""
    value, sigma = (1e3 * late[name] for name in ("value_s", "sigma_s"))
    stamped = f"of {late['robot']} is stamped {value:.2f} ms +- {sigma:.2f} ms late"
    if late.get("drift"):
        drift, known = (1e6 * late[name] for name in ("drift", "drift_sigma"))
        stamped += f" in the middle of its way, and {drift:.1f} +- {known:.1f} microseconds more each second"
    return f"{stamped}, and was matched so"


def _lost(lost: Report) -> str:
    """What is in no map, and why."""
    rows = f" ({counted(lost['rows'], 'row')})" if lost["rows"] else ""
    return f"{lost['what']}{rows}: {lost['reason']}"


def _rejected(found: Report | None) -> Rows:
    """How many sightings were wrong, and whose."""
    if found is None:
        return []
    if found["count"] is None:
        return [("wrong", sentence) for sentence in found["sentences"]]
    total = f"{found['count']:,} of {counted(found['of'], 'sighting')}"
    if found.get("left_out", True):
        return [("wrong", f"{total}, left out"), *(("", sentence) for sentence in found["sentences"])]
    one = found["count"] == 1
    sure = ("is" if one else "are") + " wrong" if "rows" in found else f"look{'s' if one else ''} wrong at this map"
    done = "left as they are; --reject finds them and leaves them out"
    return [("wrong", f"{total} {sure}, {done}"), *(("", sentence) for sentence in found["sentences"])]


def _suspicions(found: Report | None) -> Rows:
    """Who is not to be believed, and what was done about it."""
    if found is None or not found["sentences"]:
        return []
    done = "put right, or left out" if found["mended"] else "left as it is; --repair puts it right"
    left = "left as it is, and --repair leaves it too"  # nobody can say what is wrong
    if not any(found[kind] for kind in ("labels", "mistaken", "robots")):
        done = left
    first = len(found["sentences"]) - len(found["themselves"])
    said, alone = found["sentences"][:first], found["sentences"][first:]
    rows = [*(("suspicious", sentence) for sentence in said), *([("", done)] if said and done != left else [])]
    rows += [("suspicious", sentence) for sentence in alone]
    return [*rows, ("", left)] if alone or done == left else rows


def _weak(components: list[Report | None]) -> Rows:
    """What a map does not know, the weakest first, and how well all else is known."""
    known = [weak for weak in components if weak is not None]
    said = [f"Part {n}: " if len(components) > 1 else "" for n, weak in enumerate(components, 1) if weak is not None]
    told = [part["sentence"] for weak in known for part in (*weak["open"], *weak["directions"])]
    looks = [look["sentence"] for weak in known for look in weak.get("sightings", ())]
    return [
        *(("weak", sentence) for sentence in told),
        *(("known", part + weak["sentence"]) for part, weak in zip(said, known, strict=True)),
        *(("" if number else "look next", sentence) for number, sentence in enumerate(looks)),
    ]


def _fit(fit: Report) -> Rows:
    """Whether the model fits, and where it does not, what it looks like and where to look."""
    if fit["verdict"] == "unknown":
        return [("fit", fit["sentence"])]
    looks = [("looks like", cause["sentence"]) for cause in fit["causes"]]
    return [("fit", fit["sentence"]), *looks, *(("most of it", _carrier(share)) for share in fit["carriers"])]


def _carrier(share: Report) -> str:
    return (
        f"{share['what']}: {_times(share['ratio'])} times what is expected of {counted(share['rows'], 'row')}, "
        f"{share['excess']:.0%} of the excess"
    )


def _times(ratio: float) -> str:
    return f"{ratio:,.0f}" if ratio >= 10.0 else f"{ratio:.1f}"


def _cost(report: Report) -> Rows:
    """What the map costs, and what the join minimised in its place."""
    dof = counted(report["dof"], "degree of freedom", plural="degrees of freedom")
    bare = report["join_cost"]
    if report["cost"] is None:
        return [
            ("cost", "unknown: not all of the measurements are at hand; --pieces brings them"),
            ("cost of the join", f"{bare:.6g} by its own account, which takes each submap for a Gaussian ({dof})"),
        ]
    used, measured = report["numbers_used"], report["numbers_measured"]
    which = "all" if used == measured else f"{used:,} of the"
    chi2 = "" if report["chi2"] == report["cost"] else f"chi2 with outliers in full {report['chi2']:.6g}, "
    rows = [("cost", f"{report['cost']:.6g} of {which} {measured:,} numbers measured ({chi2}{dof})")]
    if bare is not None and abs(bare - report["cost"]) > 1e-6 * max(report["cost"], UNSEEN):
        rows.append(("cost of the join", f"{bare:.6g} by its own account, which takes each submap for a Gaussian"))
    return rows


def exactness(report: Report) -> str:
    """How far a join is from the full least squares, or why nobody knows."""
    found, cost = report["exactness"], report["cost"] or 0.0
    if found is None:
        return str(report["exactness_unknown"])
    sent = f"; {counted(found['rounds'], 'round')}, {found['bytes']:,} bytes" if found["bytes"] else ""
    decrease = found["gradient_norm"] ** 2
    if decrease <= UNSEEN * max(cost, 1.0):
        return f"the full least squares to rounding, {found['max_shift_sigma']:.1g} sigma at most{sent}"
    above = f"{found['relative_cost_gap']:.2g} of the cost" if cost > 1.0 else f"a cost of {decrease:.2g}"
    farther = (
        "" if found["max_shift_sigma"] < FAR else "; `teamslam run --exact` goes on from there to full least squares"
    )
    return f"about {above} above full least squares, {found['max_shift_sigma']:.2g} sigma at most{sent}{farther}"


def _dropped(report: Report) -> Rows:
    if not report["dropped"]:
        return []
    reasons = (("", f"{dropped['count']}: {dropped['reason']}") for dropped in report["dropped_reasons"])
    return [("dropped", f"{counted(report['dropped'], 'row')} by the reader"), *reasons]


def _scores(report: Report) -> Rows:
    """Errors against the truth, each with what it rests on."""
    compared, parts = report["compared"], report["parts"]
    if compared is None:
        return [("errors", "unknown: no truth")]
    if compared["note"] and not compared["poses"] and not compared["landmarks"]:
        return [("errors", f"unknown: {compared['note']}")]
    aligned = "" if len(parts) == 1 else ", each part aligned by itself"
    rows = [
        (f"{name} RMSE", _error(report[field], compared[what], sum(part[what] for part in parts), what, aligned))
        for name, field, what in (
            ("robot position", "robot_position_rmse_m", "poses"),
            ("landmark", "landmark_rmse_m", "landmarks"),
        )
    ]
    if compared["note"]:
        rows.append(("truth", compared["note"]))
    if report.get("contradicted"):
        rows.append(("truth and map disagree", report["contradicted"]["sentence"]))
    rows += [("in the world", found["sentence"]) for found in report.get("in_world") or ()]
    if report["nees_per_dof"] is not None:
        rows.append(("NEES / dof", f"{report['nees_per_dof']:.3f} (1 where the covariances are honest)"))
    return rows


def _error(value: float | None, known: int, of: int, what: str, aligned: str) -> str:
    if value is None:
        return f"none: there are no {what}" if not of else f"unknown: the truth knows none of the {of} {what}"
    return (
        f"{value:.4f} m" + ("" if known == of else f" over the {known} of {of} {what} that the truth knows") + aligned
    )


def _parts(parts: Sequence[Report]) -> Iterator[tuple[str, str]]:
    """A line for each map of a team that came apart."""
    for number, part in enumerate(parts, start=1):
        cost = part["cost"] if part["cost"] is not None else part["join_cost"]
        errors = [
            f"{noun} RMSE {part[field]:.4f} m"
            for noun, field in (("robots'", "robot_position_rmse_m"), ("landmarks'", "landmark_rmse_m"))
            if part[field] is not None
        ]
        who = f"robot{'s' * (len(part['robots']) != 1)} {', '.join(part['robots'])}"
        held = counted(part["poses"], "pose", part["landmarks"], "landmark")
        yield f"part {number}", "; ".join([f"{who}: {held}", f"cost {cost:.6g}", *errors])


def _steps(report: Report) -> str:
    """How many steps what solve took."""
    join = "of the join" if report["order"] == "at once" else "of the last join"
    solve = "of full least squares" if report["method"] == "full" else "in rounds" if report["exact"] else join
    return f"{counted(report['iterations'], 'step')} {solve}"


def counted(*counts: Any, plural: str | None = None) -> str:
    """Numbers with their nouns: counted(1, "robot", 2, "pose") is '1 robot, 2 poses'."""
    pairs = zip(counts[::2], counts[1::2], strict=True)
    return ", ".join(f"{count:,} {noun if count == 1 else plural or noun + 's'}" for count, noun in pairs)


def comparison(records: "Mapping[str, Record]") -> tuple[list[str], list[list[str]]]:
    """Several runs on one log side by side: the columns and the rows of a table."""
    columns = ["method", "cost", "robots' RMSE [m]", "landmarks' RMSE [m]", "NEES / dof", "steps", "seconds"]
    rows = []
    for name, record in records.items():
        report = record.report
        errors = [report[field] for field in ("robot_position_rmse_m", "landmark_rmse_m", "nees_per_dof")]
        rows.append(
            [
                name,
                "-" if report["cost"] is None else f"{report['cost']:.3f}",
                *("-" if error is None else f"{error:.4f}" for error in errors),
                str(report["iterations"]),
                f"{report['seconds']:.2f}",
            ]
        )
    return columns, rows

"""A report in words, for the screen."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from teamslam.results import Record


def outcome(report: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What a run came to, as names and values."""
    rows = [
        ("status", str(report["status"])),
        ("cost", f"{report['cost']:.6g}  (chi2 {report['chi2']:.6g}, {report['dof']} degrees of freedom)"),
        ("went in", f"{report['robots']} robots, {report['poses']} poses, {report['landmarks']} landmarks"),
        ("robot position RMSE", metres(report["robot_position_rmse_m"])),
        ("landmark RMSE", metres(report["landmark_rmse_m"])),
        ("NEES / dof", number(report["nees_per_dof"])),
        ("took", f"{report['seconds']:.2f} s, {report['iterations']} iterations"),
    ]
    if report["dropped"]:
        rows.insert(3, ("dropped", f"{report['dropped']} rows; `teamslam info` says why"))
    if report["method"] == "join":
        rows.insert(2, ("exactness", exactness(report["exactness"])))
    rows[1:1] = [("ambiguous", sentence) for sentence in report.get("ambiguities", [])]
    if report["components"] > 1:
        rows.insert(1, ("components", f"{report['components']}: the team could not be joined into one map"))
        rows[2:2] = [("", reason) for reason in report["reasons"]]
    return rows


def exactness(found: Mapping[str, Any] | None) -> str:
    """How far a join is from the full least squares, or why nobody knows."""
    if found is None:
        return "unknown: the pieces of log are not at hand, or do not determine all"
    gap, shift = f"{found['relative_cost_gap']:.2g}", f"{found['max_shift_sigma']:.2g}"
    rounds = "1 round" if found["rounds"] == 1 else f"{found['rounds']} rounds"
    return f"{gap} of the cost above full least squares, {shift} sigma at most; {rounds}, {found['bytes']:,} bytes"


def metres(value: float | None) -> str:
    """A length, or why there is none."""
    return "unknown: no truth" if value is None else f"{value:.4f} m"


def number(value: float | None) -> str:
    """A number, or why there is none."""
    return "unknown: no truth" if value is None else f"{value:.3f}"


def comparison(records: "Mapping[str, Record]") -> tuple[list[str], list[list[str]]]:
    """Several runs on one log side by side: the columns and the rows of a table."""
    columns = ["method", "cost", "robots' RMSE [m]", "landmarks' RMSE [m]", "NEES / dof", "iterations", "seconds"]
    rows = []
    for name, record in records.items():
        report = record.report
        errors = [report[field] for field in ("robot_position_rmse_m", "landmark_rmse_m", "nees_per_dof")]
        rows.append(
            [
                name,
                f"{report['cost']:.3f}",
                *("-" if error is None else f"{error:.4f}" for error in errors),
                str(report["iterations"]),
                f"{report['seconds']:.2f}",
            ]
        )
    return columns, rows

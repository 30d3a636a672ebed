"""What `teamslam team` writes of a team that drove and exchanged, as one record: report.json.

robots            names;   rows: taken, repeated, late
maps_equal        whether all robots' maps are equal, to the bit;   settled_s: how long after the last row
equal_to_offline  whether they are the join of the submaps that `split` and `build` make of the same log, to the bit
in_short          how many submaps went rounded or condensed, because links are tight: then the map is not the
                  offline one to the bit
rounds            exact rounds between robots, for each part of the team map: its `robots`, the `exactness` that they
                  came to, or `why` there is none, and whose submaps stood `as_sent`, because these robots were away
components        parts of the team map;   missing, refused: what robots know of and lack, or were refused
robot_position_rmse_m, landmark_rmse_m      of the first part of the team map, against the truth
exact             the same two of the first robot's map after exact rounds, as far as there is one
online_position_rmse_m                      of the poses told at the time, aligned robot by robot
alone             the same three of each robot that has nothing but its own log: its map, and what it tells at the time
links             bytes from whom to whom: bodies (by kind: sparse, partial, condensed, announcement, removal) and all
                  else; those that were lost count;   withheld: packets that would have been more than the budget
"""

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.fleet import Fleet, Member
from teamslam.frontend.agreed import with_poses
from teamslam.geometry import Array, IntArray, align
from teamslam.io import read_submaps
from teamslam.joining import Joined, build, split
from teamslam.live import drive, replayed
from teamslam.metrics import score
from teamslam.model import Dataset, Names, Submap, Values, is_pose, pose_key, robot_of
from teamslam.robot import Atlas, Estimate, Options, Robot
from teamslam.robot.peer import EVERYONE
from teamslam.team import SubmapSet
from teamslam.wire.messages import canonical

Told = tuple[int, object, Array]


def report_of(log: Dataset, found: Fleet, options: Options) -> tuple[dict[str, Any], Joined | None]:
    """The record, and the team map of the first robot."""
    names, members = log.names, found.members
    maps = {number: joined(member.peer.held) for number, member in members.items()}
    bits = {number: bits_of(made) for number, made in maps.items()}
    offline = bits_of(joined(SubmapSet.of(*offline_submaps(log, options))))
    first = next(iter(maps.values()), None)
    whole = first.map if first is not None else None
    record: dict[str, Any] = {
        "robots": {names.robot(number): _robot(member) for number, member in members.items()},
        "maps_equal": len(set(bits.values())) == 1,
        "equal_to_offline": set(bits.values()) == {offline},
        "in_short": max(member.peer.in_short for member in members.values()),
        "settled_s": found.settled_s,
        "rounds": _rounds([member.accounts for member in members.values()]),
        "components": len(first.components) if first is not None else 0,
        **_scores(whole, log.truth),
        "exact": _scores(next(iter(next(iter(members.values())).rounds.maps), None), log.truth),
        "online_position_rmse_m": _online([told_of(e) for m in members.values() for e in m.told], log.truth),
        "alone": {names.robot(number): _alone(log, number, options) for number in members},
        "links": links_of(found, names),
    }
    return record, first


def offline_submaps(log: Dataset, options: Options) -> list[Submap]:
    """What `split` and `build` make of a log, with poses wherever a submap of another robot names one (`agreed`);
    pieces that give no submap are left out, as they are live."""
    pieces = split(log, poses_per_piece=options.poses_per_piece, heading_sigma=options.heading_sigma)
    made = [_built(piece) for piece in pieces]
    while True:
        named = np.unique(np.concatenate([np.zeros(0, np.int64), *(_named(submap) for submap in made if submap)]))
        agreed = [with_poses(piece, piece.tables[0].robot, named) for piece in pieces]
        if all(more is piece for more, piece in zip(agreed, pieces, strict=True)):
            return [submap for submap in made if submap]
        made = [old if a is b else _built(a) for a, b, old in zip(agreed, pieces, made, strict=True)]
        pieces = agreed


def _built(piece: Dataset) -> Submap | None:
    try:
        return build(piece)
    except TeamslamError:
        return None


def _named(submap: Submap) -> IntArray:
    """The poses of other robots that a submap names."""
    keys = np.concatenate([submap.keys, *(table.keys.ravel() for table in submap.raw)])
    return np.asarray(keys[is_pose(keys) & (robot_of(keys) != robot_of(submap.base))])


def joined(known: SubmapSet) -> Joined | None:
    """The map of a set; None where there is none."""
    try:
        return known.join() if known.submaps else None
    except TeamslamError:
        return None


def bits_of(made: Joined | None) -> bytes:
    """A map to the bit."""
    return b"" if made is None else bits_of_parts(component.map for component in made.components)


def bits_of_parts(parts: Iterable[Submap]) -> bytes:
    """The parts of a map to the bit, but for their versions: these say how often rows and poses came after a piece was
    closed, which is of the course of things and not of the map."""
    return b"".join(canonical(replace(part, version=0)) for part in parts)


def links_of(found: Fleet, names: Names) -> list[dict[str, Any]]:
    """Bytes by line: what each robot's ledger says. Law: it is what the links carried."""
    out = []
    for a, member in found.members.items():
        to_all = member.peer.lines[EVERYONE].sent if EVERYONE in member.peer.lines else None
        for b in found.members:
            if a == b:
                continue
            sent = member.peer.lines[b].sent if b in member.peer.lines else None
            out.append(
                {
                    "from": names.robot(a),
                    "to": names.robot(b),
                    "bodies": sent.bodies if sent else 0,
                    "body_bytes": sent.body_bytes if sent else 0,
                    "kinds": dict(sent.kinds) if sent else {},
                    "word_bytes": sum(s.word_bytes for s in (sent, to_all) if s),
                    "withheld": sent.withheld if sent else 0,
                    "carried_bytes": found.carried.get((a, b), 0),
                }
            )
    return out


def told_of(estimate: Estimate) -> Told:
    """A pose that was told: its key, its frame, its place."""
    return estimate.key, estimate.frame, estimate.pose.translation


def _robot(member: Member) -> dict[str, Any]:
    counts, peer = member.robot.counts, member.peer
    return {
        "rows": {"taken": counts.taken, "repeated": counts.repeated, "late": counts.late},
        "submaps": len(peer.held.submaps),
        "missing": [f"{entry.id}, version {entry.version}" for entry in peer.missing],
        "refused": [f"{name}: {reason}" for name, reason in peer.left_out.items()],
        "refused_packets": dict(peer.refused),
        "unbuilt": list(member.mapper.atlas.unbuilt),
    }


def _rounds(accounts: Sequence[Sequence[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Of what robots say of each part of the map, that of one who knows how its rounds ended, or else why not."""
    parts: dict[tuple[str, ...], dict[str, Any]] = {}
    for account in (account for of_robot in accounts for account in of_robot):
        held = parts.setdefault(tuple(account["robots"]), account)
        if held["exactness"] is None and (account["exactness"] is not None or not held["why"]):
            parts[tuple(account["robots"])] = account
    return list(parts.values())


def _scores(map: Submap | None, truth: Values | None) -> dict[str, float | None]:
    scored = score(map, truth) if map is not None and truth is not None else None
    return {
        "robot_position_rmse_m": scored.robot_position_rmse_m if scored else None,
        "landmark_rmse_m": scored.landmark_rmse_m if scored else None,
    }


def _alone(log: Dataset, number: int, options: Options) -> dict[str, float | None]:
    """What a robot comes to that drives through its log and hears of nobody."""
    told, atlas = list[Told](), Atlas()
    for moment in drive(Robot.of(log, number, options), (tables for _, tables in replayed(log, number))):
        told += [told_of(moment.now)] if moment.now is not None else []
        atlas = moment.atlas
    made = joined(SubmapSet.of(*atlas.submaps))
    scores = _scores(made.map if made is not None else None, log.truth)
    return scores | {"online_position_rmse_m": _online(told, log.truth)}


def _online(told: Sequence[Told], truth: Values | None) -> float | None:
    """The error of poses as they were told, those of one robot in one frame after one alignment."""
    if truth is None:
        return None
    by_frame: dict[tuple[int, object], list[Told]] = {}
    for key, frame, place in told:
        if truth.layout.contains(key):
            by_frame.setdefault((int(robot_of(key)), frame), []).append((key, frame, place))
    squared = []
    for group in by_frame.values():
        places = np.stack([place for _, _, place in group])
        true = truth.positions(np.array([key for key, _, _ in group]), places.shape[-1])
        squared.append(np.sum((align(places, true).pose.act(places) - true) ** 2, -1))
    return float(np.sqrt(np.mean(np.concatenate(squared)))) if squared else None


# --- of robots in processes of their own ---------------------------------------------------------------------------


def report_of_folders(
    log: Dataset, out: Path, statuses: Mapping[str, Mapping[str, Any]], options: Options
) -> tuple[dict[str, Any], list[Submap]]:
    """The record of robots that wrote a folder each, by name, and the parts of the first one's map."""
    maps = {name: _parts_in(out / name / "maps") for name in statuses}
    exact = [_parts_in(out / name / "exact") for name in statuses]
    bits = {name: bits_of_parts(parts) for name, parts in maps.items()}
    offline = bits_of(joined(SubmapSet.of(*offline_submaps(log, options))))
    first = next(iter(maps.values()), [])
    names = log.names
    found = [number for number in sorted(log.robots) if names.robot(number) in statuses]
    record: dict[str, Any] = {
        "robots": {
            name: {
                "rows": status.get("rows"),
                "submaps": len(status.get("holds", ())),
                "missing": status.get("missing"),
                "refused_packets": status.get("refused_packets"),
                "journal": status.get("journal"),
            }
            for name, status in statuses.items()
        },
        "maps_equal": len(set(bits.values())) == 1,
        "equal_to_offline": set(bits.values()) == {offline},
        "in_short": max(status.get("in_short", 0) for status in statuses.values()),
        "rounds": _rounds([status["rounds"]["parts"] for status in statuses.values()]),
        "components": len(first),
        **_scores(first[0] if first else None, log.truth),
        "exact": _scores(next((parts[0] for parts in exact if parts), None), log.truth),
        "online_position_rmse_m": _online([t for name in statuses for t in _told_in(out / name, log)], log.truth),
        "alone": {names.robot(number): _alone(log, number, options) for number in found},
        "links": [
            {
                "from": name,
                "to": other,
                "bodies": sent["bodies"],
                "body_bytes": sent["body_bytes"],
                "kinds": sent["kinds"],
                "withheld": sent["withheld"],
                "word_bytes": sent["word_bytes"] + status["links"].get("all", {}).get("word_bytes", 0),
            }
            for name, status in statuses.items()
            for other, sent in status.get("links", {}).items()
            if other != "all"
        ],
    }
    return record, first


def _parts_in(folder: Path) -> list[Submap]:
    return read_submaps(folder) if folder.is_dir() else []


def _told_in(folder: Path, log: Dataset) -> list[Told]:
    """The poses that a robot told, from its folder."""
    numbers = {log.names.robot(number): number for number in log.robots}
    found: list[Told] = []
    with (folder / "poses.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            key = int(pose_key(numbers[row["robot"]], round(float(row["stamp_s"]) / log.names.tick_s)))
            place = np.array([float(row[name]) for name in ("x_m", "y_m", "z_m") if name in row])
            found.append((key, (row["frame"], row["frame_stamp_s"]), place))
    return found

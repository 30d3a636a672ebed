"""What `teamslam team` writes of a team that drove and exchanged, as one record: report.json.

robots            names;   rows: taken, repeated, late
maps_equal        whether all robots' maps are equal, to the bit;   settled_s: how long after the last row
equal_to_offline  whether they are the join of the submaps that `split` and `build` make of the same log, to the bit
components        parts of the team map;   missing, refused: what robots know of and lack, or were refused
robot_position_rmse_m, landmark_rmse_m      of the first part of the team map, against the truth
online_position_rmse_m                      of the poses told at the time, aligned robot by robot
alone             the same two of each robot with nothing but its own log
links             bytes from whom to whom: bodies of submaps, and all else; those that were lost count
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.fleet import Fleet, Member
from teamslam.geometry import align
from teamslam.joining import Joined, build, split
from teamslam.metrics import score
from teamslam.model import Dataset, Names, Submap, Values, is_pose
from teamslam.robot import Estimate, Options
from teamslam.robot.peer import EVERYONE
from teamslam.team import SubmapSet
from teamslam.wire.messages import canonical


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
        "settled_s": found.settled_s,
        "components": len(first.components) if first is not None else 0,
        **_scores(whole, log.truth),
        "online_position_rmse_m": _online([e for member in members.values() for e in member.told], log.truth),
        "alone": {names.robot(number): _scores(_alone(member), log.truth) for number, member in members.items()},
        "links": links_of(found, names),
    }
    return record, first


def offline_submaps(log: Dataset, options: Options) -> list[Submap]:
    """What `split` and `build` make of a log; pieces that give no submap are left out, as they are live."""
    found = []
    for piece in split(log, poses_per_piece=options.poses_per_piece, heading_sigma=options.heading_sigma):
        try:
            found.append(build(piece))
        except TeamslamError:
            continue
    return found


def joined(known: SubmapSet) -> Joined | None:
    """The map of a set; None where there is none."""
    try:
        return known.join() if known.submaps else None
    except TeamslamError:
        return None


def bits_of(made: Joined | None) -> bytes:
    """A map to the bit."""
    return b"" if made is None else b"".join(canonical(component.map) for component in made.components)


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
                    "word_bytes": sum(s.word_bytes for s in (sent, to_all) if s),
                    "carried_bytes": found.carried.get((a, b), 0),
                }
            )
    return out


def _robot(member: Member) -> dict[str, Any]:
    counts, peer = member.robot.counts, member.peer
    return {
        "rows": {"taken": counts.taken, "repeated": counts.repeated, "late": counts.late},
        "submaps": len(peer.held.submaps),
        "missing": [f"{entry.id}, version {entry.version}" for entry in peer.missing],
        "refused": [f"{r.name}: {r.reason}" for r in peer.held.admission.refused],
        "refused_packets": dict(peer.refused),
        "unbuilt": list(member.mapper.atlas.unbuilt),
    }


def _scores(map: Submap | None, truth: Values | None) -> dict[str, float | None]:
    scored = score(map, truth) if map is not None and truth is not None else None
    return {
        "robot_position_rmse_m": scored.robot_position_rmse_m if scored else None,
        "landmark_rmse_m": scored.landmark_rmse_m if scored else None,
    }


def _alone(member: Member) -> Submap | None:
    made = joined(SubmapSet.of(*member.mapper.atlas.submaps))
    return None if made is None else made.map


def _online(told: Sequence[Estimate], truth: Values | None) -> float | None:
    """The error of poses as they were told, those of one robot in one frame after one alignment."""
    if truth is None:
        return None
    known = [e for e in told if truth.layout.contains(e.key)]
    by_frame: dict[tuple[int, int], list[Estimate]] = {}
    for estimate in known:
        assert is_pose(estimate.key)
        by_frame.setdefault((estimate.key >> 51, estimate.frame), []).append(estimate)
    squared = []
    for group in by_frame.values():
        places = np.stack([e.pose.translation for e in group])
        true = truth.positions(np.array([e.key for e in group]), places.shape[-1])
        squared.append(np.sum((align(places, true).pose.act(places) - true) ** 2, -1))
    return float(np.sqrt(np.mean(np.concatenate(squared)))) if squared else None

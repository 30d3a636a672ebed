"""A team's maps as a card: their picture with 95 % regions of the landmarks, and what is in them."""

from collections.abc import Iterable

import numpy as np

from teamslam.answers.maps import Maps, frame_of, landmark_names_in, robots_in
from teamslam.cards import card
from teamslam.errors import SolveError, in_words
from teamslam.model import Submap, is_pose
from teamslam.model.portrait import portrait
from teamslam.solver import Covariances

MOST_REGIONS = 500  # landmarks: of more, covariances take longer than a card may
MOST_NAMED = 6


def maps_card(title: str, team: Maps, facts: Iterable[tuple[str, str]], sentence: str = "") -> str:
    """HTML: a picture of each map (of the first four), the facts, a sentence."""
    pictures = [_picture(m, known) for m, known in zip(team.maps[:4], team.covariances[:4], strict=True)]
    return card(title, facts, picture="".join(pictures), sentence=sentence)


def facts_of(team: Maps) -> list[tuple[str, str]]:
    """What is in the maps, in words: robots, poses, landmarks, and where there are several maps, how many."""
    robots, marks = robots_in(team), landmark_names_in(team)
    poses = sum(int(is_pose(submap.keys).sum()) for submap in team.maps)
    named = ", ".join(map(in_words, robots[:MOST_NAMED])) + (", ..." if len(robots) > MOST_NAMED else "")
    apart = [("maps", f"{len(team.maps)} maps that could not be joined")] if len(team.maps) > 1 else []
    return [
        ("robots", f"{len(robots)} robot{'s' * (len(robots) != 1)} ({named})"),
        ("poses", f"{poses:,} poses"),
        ("landmarks", f"{len(marks):,} landmark{'s' * (len(marks) != 1)}"),
        *apart,
        ("frame", frame_of(team.maps[0])),
    ]


def _picture(submap: Submap, covariances: Covariances) -> str:
    keys = submap.landmark_keys
    values = submap.all_values if submap.base >= 0 else submap.values
    if len(keys) > MOST_REGIONS:
        return portrait(values)
    try:
        regions = [block[:2, :2] for block in covariances.blocks(keys)]
    except SolveError:
        return portrait(values)
    return portrait(values, keys, np.array(regions).reshape(-1, 2, 2))

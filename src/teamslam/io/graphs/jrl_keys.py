"""GTSAM's symbols in JRL and JRR files as teamslam's keys."""

from collections.abc import Mapping, Sequence
from itertools import compress

import numpy as np

from teamslam.geometry import BoolArray, IntArray
from teamslam.io.files.json_column import JsonColumn
from teamslam.io.graphs.symbols import COUNT_BITS, LOWER_FIRST
from teamslam.model import landmark_key, pose_key
from teamslam.model.keys import MAX_INDEX

LARGEST_SYMBOL = (1 << 63) - 1


def of_landmarks(symbols: Sequence[int], points: BoolArray | bool) -> BoolArray:
    """Which symbols (n,) are landmarks': those used as `points`, and poses that bear the letter of landmarks."""
    return np.asarray(points | (_codes(symbols) >> COUNT_BITS == ord(LOWER_FIRST.landmark)))


def keys_of(symbols: Sequence[int], landmarks: BoolArray, marks: Mapping[int, int], places: JsonColumn) -> IntArray:
    """Keys (n,) of symbols, some of them landmarks' whose numbers are `marks`. InputError, at the place, for a pose
    that is no robot's."""
    codes = _codes(symbols)
    robots, counts = LOWER_FIRST.numbers(codes >> COUNT_BITS), codes & ((1 << COUNT_BITS) - 1)
    places.refuse(
        ~landmarks & ((robots == 0) | (counts > MAX_INDEX)),
        lambda row: f"the key {symbols[row]} is no robot's pose: its top byte should be a letter (but L)",
    )
    out = np.empty(len(symbols), np.int64)
    out[~landmarks] = pose_key(robots[~landmarks], counts[~landmarks])
    out[landmarks] = landmark_key(np.array([marks[symbol] for symbol in compress(symbols, landmarks)], np.int64))
    return out


def _codes(symbols: Sequence[int]) -> IntArray:
    """Symbols (n,) as numbers of 64 bits; -1, which is no symbol, for one that is out of range."""
    return np.array([symbol if 0 <= symbol <= LARGEST_SYMBOL else -1 for symbol in symbols], np.int64)

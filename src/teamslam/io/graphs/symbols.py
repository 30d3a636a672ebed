"""Variables that files name by a letter and a count ('a12'), as text or as the 64-bit symbols of GTSAM.

    symbol         = letter << 56 | count
    labelled symbol = letter << 56 | robot's letter << 48 | count

Robots are numbered by their letter's place in the alphabet of the format, so that a robot has the same number in every
file; one letter is kept for landmarks.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import IntArray
from teamslam.model import index_of, landmark_number, robot_of
from teamslam.model.keys import MAX_INDEX

COUNT_BITS, LABEL_BITS = 56, 48
LOWER, UPPER = "abcdefghijklmnopqrstuvwxyz", "ABCDEFGHIJKLMNOPQRSTUVWXYZ"


@dataclass(frozen=True)
class Alphabet:
    """The letters that stand for robots 1, 2, ..., and the one that stands for landmarks."""

    robots: str
    landmark: str

    def letter(self, robot: int) -> str | None:
        """The letter of a robot's number; None where the alphabet ends before."""
        return self.robots[robot - 1] if 1 <= robot <= len(self.robots) else None

    def lacks(self, robots: Iterable[int], place: str) -> str | None:
        """Which robot's letter a place lacks, in words; None where all have one."""
        without = [robot for robot in sorted(robots) if self.letter(robot) is None]
        if not without:
            return None
        return f"robot {without[0]} has no letter in {place}, which end at {len(self.robots)} robots"

    def numbers(self, letters: IntArray) -> IntArray:
        """The robots' numbers of letters given as character codes (n,); 0 where one is no robot's."""
        lookup = np.zeros(256, np.int64)
        lookup[[ord(letter) for letter in self.robots]] = np.arange(1, len(self.robots) + 1)
        return np.asarray(lookup[np.clip(letters, 0, 255)])

    def symbols(self, keys: IntArray) -> IntArray:
        """The 64-bit symbols of keys, any shape, of robots that all have a letter (see `lacks`)."""
        letters = np.array([ord(self.landmark), *map(ord, self.robots)], np.int64)
        return np.asarray(letters[robot_of(keys)] << COUNT_BITS | index_of(keys))


LOWER_FIRST = Alphabet(LOWER + UPPER.replace("L", ""), "L")  # GTSAM's symbols in g2o and JRL files: robots a, b, c
UPPER_FIRST = Alphabet(UPPER.replace("L", "") + LOWER, "L")  # PyFG: robots A, B, C


def split_symbol(symbol: int) -> tuple[str, int]:
    """(letter, count) of a 64-bit symbol; letter '' where the top byte is no printable letter."""
    top = symbol >> COUNT_BITS
    letter = chr(top) if 33 <= top < 127 else ""
    return letter, symbol & ((1 << COUNT_BITS) - 1) if letter else symbol


def split_symbols(symbols: IntArray) -> tuple[IntArray, IntArray]:
    """The letters (n,) of poses' symbols as character codes, 0 for plain numbers, and their counts (n,).

    Of a labelled symbol ('x' of robot 'B'), the letter is the robot's.
    """
    top = symbols >> COUNT_BITS
    lettered = (top >= 33) & (top < 127)
    counts = np.where(lettered, symbols & ((1 << COUNT_BITS) - 1), symbols)
    label = (counts >> LABEL_BITS) & 255
    labelled = lettered & (label >= ord("A")) & (label <= ord("z"))
    letters = np.where(labelled, label, np.where(lettered, top, 0))
    return letters, np.where(labelled, counts & ((1 << LABEL_BITS) - 1), counts)


def join_symbol(letter: str, count: int) -> int:
    """The 64-bit symbol of a letter and a count. Law: split_symbol(join_symbol(l, c)) = (l, c)."""
    return ord(letter) << COUNT_BITS | count


def fits(count: int) -> bool:
    """True where a count can be a pose's index or a landmark's number."""
    return 0 <= count <= MAX_INDEX


def landmark_numbers(symbols: Iterable[int]) -> dict[int, int]:
    """A number for each landmark's symbol or plain id: its count where these differ, else a hash of its name."""
    parts = {symbol: split_symbol(symbol) for symbol in symbols}
    counts = [count for _, count in parts.values()]
    if len(set(counts)) == len(counts) and all(map(fits, counts)):
        return {symbol: count for symbol, (_, count) in parts.items()}
    return {symbol: landmark_number(f"{letter}:{count}") for symbol, (letter, count) in parts.items()}

"""Names of variables: one 64-bit integer for each robot pose and each landmark.

    key = robot << 51 | index          a pose:     robot 1 .. 4095, index = time in ticks (or a plain count)
    key = number                       a landmark: 0 <= number < 2^51
          3 << 49 | robot << 37 | row  one sighting of a landmark that nobody called by name: a landmark of its own,
                                       until it is associated with others
    key < WORLD                        a parameter: systematic errors of the measurements of one submap

A variable is named by who it is and when, never by its place in a vector: the pose of robot j at time t that robot i
saw and the one in j's own submap are two images of one variable, and carry one key. Ticks of a microsecond last until
2041. `WORLD` names the frame of absolute measurements (a surveyed or GPS frame).
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from teamslam.errors import ModelError, in_words
from teamslam.geometry import AnyArray, BoolArray, IntArray

INDEX_BITS = 51
MAX_INDEX = (1 << INDEX_BITS) - 1
MAX_ROBOT = (1 << 12) - 1
WORLD = -1
PARAMETER_BITS = 10  # keys of one submap's systematic errors
UNNAMED = 3 << 49  # to 2^51: keys of sightings without a name
ROW_BITS = 37


def pose_key(robot: int | AnyArray, index: int | AnyArray) -> IntArray:
    """Keys of a robot's poses; robot 1..4095, index 0..2^51-1, any shapes that broadcast. Raises ModelError outside."""
    robots, indices = np.asarray(robot, np.int64), np.asarray(index, np.int64)
    if robots.size and (robots.min() < 1 or robots.max() > MAX_ROBOT):
        raise ModelError(f"robot numbers run from 1 to {MAX_ROBOT}, found {robots.min()} to {robots.max()}")
    if indices.size and (indices.min() < 0 or indices.max() > MAX_INDEX):
        raise ModelError(f"pose indices (ticks) run from 0 to 2^51 - 1, found {indices.min()} to {indices.max()}")
    return np.asarray(robots << INDEX_BITS | indices)


def landmark_key(number: int | AnyArray) -> IntArray:
    """Keys of landmarks: their numbers, 0..2^51-1. Raises ModelError outside."""
    numbers = np.asarray(number, np.int64)
    if numbers.size and (numbers.min() < 0 or numbers.max() > MAX_INDEX):
        raise ModelError(f"landmark numbers run from 0 to 2^51 - 1, found {numbers.min()} to {numbers.max()}")
    return numbers


def landmark_number(name: str) -> int:
    """The number of a landmark that people call `name`: the integer itself where it is one, or one that was written as
    a float (7.0), else a hash of the name.

    The hash (2^50 to 3 * 2^49) is the same on every machine, so robots agree on it without talking.
    """
    text = whole(name.strip())
    if text.isascii() and text.isdigit() and int(text) < 1 << (INDEX_BITS - 1):
        return int(text)
    return _hashed(text)


def twin_key(mark: int, which: str) -> int:
    """The key of what may be another landmark than `mark`, though it is called so: the `which` of them tells twins of
    one landmark apart.

    Law: a landmark's key for every landmark's key, the same every time it is asked, never an unnamed sighting's; it is
    another landmark's by a chance of 2^-49, as a name's number is.
    """
    return int(landmark_key(_hashed(f"{int(landmark_key(mark))} {which}")))


def _hashed(text: str) -> int:
    digest = hashlib.blake2b(text.encode(), digest_size=8).digest()
    return (1 << (INDEX_BITS - 1)) | (int.from_bytes(digest, "little") & ((1 << (INDEX_BITS - 2)) - 1))


def whole(name: str) -> str:
    """A name without the zeros after the point of a whole number: 7 for 7.0, as pandas writes a column of integers in
    which one cell is empty."""
    digits, point, zeros = name.partition(".")
    return digits if point and digits.isascii() and digits.isdigit() and not zeros.strip("0") else name


def unnamed_key(robot: int, row: AnyArray) -> IntArray:
    """The keys (m,) of a robot's sightings of landmarks without a name: each is a landmark of its own, so far.

    Raises ModelError for rows from 2^37 on.
    """
    rows = np.asarray(row, np.int64)
    if not 1 <= robot <= MAX_ROBOT or (rows.size and (rows.min() < 0 or rows.max() >= 1 << ROW_BITS)):
        raise ModelError(f"a log has rows 0 to 2^{ROW_BITS} - 1 of robots 1 to {MAX_ROBOT}, found {rows.max()}")
    return np.asarray(UNNAMED | np.int64(robot) << ROW_BITS | rows)


def is_unnamed(keys: int | AnyArray) -> BoolArray:
    """True where a key is a sighting of a landmark that nobody called by name."""
    found = np.asarray(keys, np.int64)
    return np.asarray((found >= UNNAMED) & (found <= MAX_INDEX))


def robot_of(keys: int | AnyArray) -> IntArray:
    """The robot number of pose keys; 0 for landmarks, below for WORLD and parameters."""
    return np.asarray(np.asarray(keys, np.int64) >> INDEX_BITS)


def index_of(keys: int | AnyArray) -> IntArray:
    """The tick or count of pose keys; the number of landmarks."""
    return np.asarray(np.asarray(keys, np.int64) & MAX_INDEX)


def is_pose(keys: int | AnyArray) -> BoolArray:
    """True where a key names a robot's pose."""
    return np.asarray(robot_of(keys) > 0)


def is_landmark(keys: int | AnyArray) -> BoolArray:
    """True where a key names a landmark."""
    return np.asarray(robot_of(keys) == 0)


def parameter_keys(owner: str, count: int, beside: AnyArray | None = None) -> IntArray:
    """Keys (count,) for systematic errors of the measurements of `owner`, the id of a submap: the same everywhere, the
    first that are not among those `beside`."""
    digest = int.from_bytes(hashlib.blake2b(owner.encode(), digest_size=8).digest(), "little") >> 12
    own = np.asarray(WORLD - 1 - (digest << PARAMETER_BITS) - np.arange(1 << PARAMETER_BITS), np.int64)
    return own[:count] if beside is None else own[~np.isin(own, beside)][:count]


def is_parameter(keys: int | AnyArray) -> BoolArray:
    """True where a key names systematic errors of measurements."""
    return np.asarray(np.asarray(keys, np.int64) < WORLD)


@dataclass(frozen=True)
class Names:
    """What people call robots and landmarks, and how long a tick is.

    `tick_s` [s] turns a pose's index into its stamp: 1e-6 for stamped logs, 1.0 where poses are only counted.
    Numbers without an entry are called by their number.
    """

    robots: Mapping[int, str] = field(default_factory=dict)
    landmarks: Mapping[int, str] = field(default_factory=dict)
    tick_s: float = 1e-6

    def __repr__(self) -> str:
        tick = "" if self.tick_s == 1e-6 else f", a tick of {self.tick_s:g} s"
        return f"Names({len(self.robots)} robots, {len(self.landmarks):,} landmarks{tick})"

    @property
    def counts(self) -> bool:
        """True where poses are only counted, and no stamp is a time."""
        return self.tick_s == 1.0

    def robot(self, number: int) -> str:
        """What people call a robot."""
        return self.robots.get(int(number), str(int(number)))

    def these(self, numbers: Iterable[int]) -> str:
        """Robots in words: 'robot red', 'robots red, green and blue'; of none: 'no robot'."""
        *others, last = [self.robot(number) for number in numbers] or [""]
        return f"robots {', '.join(others)} and {last}" if others else f"robot {last}" if last else "no robot"

    def landmark(self, number: int) -> str:
        """What people call a landmark."""
        return self.landmarks.get(int(number), str(int(number)))

    def stamps_s(self, keys: AnyArray) -> AnyArray:
        """The stamps [s] of pose keys."""
        return index_of(keys) * self.tick_s

    def describe(self, key: int) -> str:
        """A variable in words: 'robot 3 at 12.350 s', 'landmark 17'."""
        if key == WORLD:
            return "the world frame"
        if is_parameter(key):
            return "a systematic error of its measurements"
        if is_unnamed(key):
            robot, row = int(key - UNNAMED) >> ROW_BITS, int(key) & ((1 << ROW_BITS) - 1)
            return f"the unnamed landmark of row {row} of robot {in_words(self.robot(robot))}"
        if not is_pose(key):
            return f"landmark {in_words(self.landmark(int(index_of(key))))}"
        when = f"pose {int(index_of(key))}" if self.counts else f"{int(index_of(key)) * self.tick_s:.3f} s"
        return f"robot {in_words(self.robot(int(robot_of(key))))} at {when}"

    def merge(self, others: Iterable["Names"]) -> "Names":
        """The names of several logs together. Raises ModelError where they contradict each other."""
        robots, landmarks = dict(self.robots), dict(self.landmarks)
        for other in others:
            if other.tick_s != self.tick_s:
                raise ModelError(
                    f"two logs count time differently: a tick of {self.tick_s} s and one of {other.tick_s} s"
                )
            for mine, theirs, noun in ((robots, other.robots, "robot"), (landmarks, other.landmarks, "landmark")):
                for number, name in theirs.items():
                    if mine.setdefault(number, name) != name:
                        raise ModelError(
                            f"{noun} number {number} is called '{mine[number]}' in one log and '{name}' in another; "
                            f"give every {noun} one number for the whole team"
                        )
        return Names(robots, landmarks, self.tick_s)

"""Who is in the team: the names that files use, and the numbers that stand for them."""

import difflib
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import IntArray
from teamslam.io.files.csv_file import Csv
from teamslam.io.plain.schema import FILE, Robot, Team, numbers_of
from teamslam.model import Names, landmark_key, landmark_number, whole

NAMED = ("robot", "observer", "landmark", "other")  # the columns that hold names


class Roster:
    """Numbers by name, of the robots in team.toml and of the landmarks as files mention them."""

    def __init__(self, folder: Path, team: Team) -> None:
        self._file, self._team = folder / FILE, team
        self._robots = {robot.name: number for robot, number in zip(team.robot, numbers_of(team), strict=True)}
        self.entries: dict[int, Robot] = {self._robots[robot.name]: robot for robot in team.robot}
        self._landmarks: dict[str, int] = {}
        self._called: dict[int, str] = {}
        for name in team.landmarks:
            self.number_of(name)

    @property
    def dims(self) -> dict[int, int]:
        """The dimension that each robot moves in, by number."""
        return {number: robot.dim for number, robot in self.entries.items()}

    @property
    def known(self) -> int:
        """How many landmarks have a name so far."""
        return len(self._called)

    @property
    def names(self) -> Names:
        """What everybody is called."""
        robots = {number: robot.name for number, robot in self.entries.items() if robot.name != str(number)}
        landmarks = {number: name for number, name in self._called.items() if name != str(number)}
        return Names(robots, landmarks, self._team.tick_s)

    def number(self, robot: str) -> int:
        """The number of a robot of team.toml."""
        return self._robots[robot]

    def robots(self, csv: Csv, column: str) -> IntArray:
        """A column of robots' names as numbers (m,). InputError for a name that is not in team.toml."""
        words = csv.words(column)
        numbers = [self._robots.get(word, self._robots.get(whole(word))) for word in words.names]
        for code, word in enumerate(words.names):
            if numbers[code] is None:
                near = difflib.get_close_matches(word, list(self._robots), 1)
                hint = f"did you mean '{near[0]}'?" if near else f"team.toml has {', '.join(self._robots)}"
                row = int(np.argmax(words.codes == code))
                raise csv.fail(row, f"unknown robot '{word}'; {hint} A new robot needs a [[robot]] there", column)
        return np.array(numbers, np.int64)[words.codes]

    def landmarks(self, csv: Csv) -> IntArray:
        """The column `landmark` as keys (m,); -1 where it is empty: nobody said which landmark it is."""
        words, keys = csv.given_words("landmark"), np.full(len(csv), -1)
        numbers = np.array([self.number_of(word) for word in words.names], np.int64)
        keys[csv.given("landmark")] = landmark_key(numbers[words.codes])
        return keys

    def number_of(self, name: str) -> int:
        """The number of a landmark, which gets one where it is new; a whole number is called so, however written."""
        name = name if name in self._team.landmarks else whole(name)
        if name not in self._landmarks:
            given = self._team.landmarks.get(name)
            number = landmark_number(name) if given is None else given
            other = self._called.setdefault(number, name)
            if other != name and not (_is_count(name) and _is_count(other)):
                raise InputError(
                    f"the landmarks '{other}' and '{name}' both have the number {number}; give one of them another",
                    path=self._file,
                    field="landmarks",
                )
            self._landmarks[name] = number
        return self._landmarks[name]


def _is_count(name: str) -> bool:
    """Names like 7 and 07, which mean one landmark."""
    return name.isascii() and name.isdigit()

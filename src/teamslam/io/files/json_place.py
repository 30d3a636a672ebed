"""JSON content with its place in the file: every error names the file and the way to the value."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from teamslam.errors import InputError
from teamslam.io.files.delimited import read_text
from teamslam.io.files.json_text import decoded
from teamslam.io.files.records import LARGEST


def read_json(path: Path) -> "Json":
    """The content of a JSON file. InputError where it is no JSON, or holds numbers that are not finite."""
    text = read_text(path)
    try:
        return Json(path, "", decoded(text))
    except json.JSONDecodeError as error:
        raise InputError(f"this is no JSON: {error.msg}", path=path, line=error.lineno) from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"this JSON cannot be read: {error}", path=path) from None


@dataclass(frozen=True)
class Json:
    """A value and where it stands, as `measurements.a[3].covariance`."""

    path: Path
    where: str
    value: Any

    def error(self, problem: str, field: str | None = None) -> InputError:
        """An InputError at this place."""
        return InputError(problem, path=self.path, field=field or self.where or None)

    def has(self, name: str) -> bool:
        """True where this is an object with such an entry."""
        return isinstance(self.value, dict) and name in self.value

    def get(self, name: str) -> "Json":
        """An entry of an object. InputError where it is missing."""
        if not isinstance(self.value, dict):
            raise self.error(f"expected an object with '{name}', found {_noun(self.value)}")
        if name not in self.value:
            raise self.error(f"'{name}' is missing; found {', '.join(map(str, self.value)) or 'nothing'}")
        return Json(self.path, f"{self.where}.{name}".lstrip("."), self.value[name])

    def items(self) -> "list[tuple[str, Json]]":
        """The entries of an object."""
        if not isinstance(self.value, dict):
            raise self.error(f"expected an object, found {_noun(self.value)}")
        return [(name, self.get(name)) for name in self.value]

    def elements(self) -> "list[Json]":
        """The elements of a list."""
        if not isinstance(self.value, list):
            raise self.error(f"expected a list, found {_noun(self.value)}")
        return [Json(self.path, f"{self.where}[{k}]", element) for k, element in enumerate(self.value)]

    def number(self) -> float:
        """A finite number."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float) or not abs(self.value) < LARGEST:
            raise self.error(f"expected a finite number, found {_noun(self.value)}")
        return float(self.value)

    def whole(self) -> int:
        """A whole number."""
        if isinstance(self.value, bool) or not isinstance(self.value, int):
            raise self.error(f"expected a whole number, found {_noun(self.value)}")
        return self.value

    def text(self) -> str:
        """A text."""
        if not isinstance(self.value, str):
            raise self.error(f"expected a text, found {_noun(self.value)}")
        return self.value

    def integer_of(self, name: str) -> int:
        """The name of an entry as a whole number."""
        if not (name.isascii() and name.isdigit() and len(name) < 20):
            raise self.error(f"expected a whole number as the name of an entry, found '{name[:60]}'")
        return int(name)


def _noun(value: Any) -> str:
    if isinstance(value, dict | list):
        return "an object" if isinstance(value, dict) else "a list"
    return f"{value!r}"[:60]

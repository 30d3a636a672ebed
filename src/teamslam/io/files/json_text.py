"""JSON decoded and encoded at once, as fast as objects can be made."""

import json
from typing import Any

import msgspec
import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.io.files.garbage import uncollected


def decoded(text: str) -> Any:
    """The content of a JSON text. ValueError or RecursionError where it is none, or holds numbers that are not finite.

    What msgspec refuses the standard library decodes, which takes a little more (halves of characters, 1e400) and says
    by line what is wrong.
    """
    with uncollected():
        try:
            return msgspec.json.decode(text)
        except (msgspec.DecodeError, RecursionError):
            return json.loads(text, parse_constant=_no_constant)


def encoded(content: Any) -> str:
    """Content as JSON on one line. Law: decoded(encoded(c)) = c, for numbers that are finite (see `finite`)."""
    try:
        return msgspec.json.encode(content).decode()
    except UnicodeEncodeError:  # halves of characters, which only the standard library spells
        return json.dumps(content, allow_nan=False)


def finite(numbers: Array) -> list[Any]:
    """Numbers, any shape, as JSON content. InputError where one is not finite: JSON has no word for it."""
    if not np.isfinite(numbers).all():
        raise InputError("JSON has no word for numbers that are not finite, and some values or covariances are not")
    return list(numbers.tolist())


def _no_constant(word: str) -> float:
    raise ValueError(f"'{word}' stands where a finite number is needed")

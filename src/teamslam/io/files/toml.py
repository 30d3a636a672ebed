"""TOML files as nested tables."""

import tomllib
from pathlib import Path
from typing import Any

from teamslam.errors import InputError
from teamslam.io.files.delimited import read_text


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file (UTF-8, with or without a byte-order mark). InputError names the file and the line."""
    try:
        return tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not valid TOML: {error}", path=path) from None
    except RecursionError:
        raise InputError("nested too deeply to be read; expected a few tables", path=path) from None

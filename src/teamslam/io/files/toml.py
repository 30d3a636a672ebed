"""TOML files as nested tables, and as records."""

import difflib
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, cast, get_args, get_type_hints

import msgspec

from teamslam.errors import InputError
from teamslam.io.files.delimited import read_text

Record = TypeVar("Record")


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file (UTF-8, with or without a byte-order mark). InputError names the file and the line."""
    text = read_text(path)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not valid TOML: {error}{_cure(str(error), text)}", path=path) from None
    except RecursionError:
        raise InputError("nested too deeply to be read; expected a few tables", path=path) from None


def _cure(problem: str, text: str) -> str:
    """What TOML wants where people write numbers as elsewhere: .05."""
    place = re.search(r"at line (\d+), column (\d+)", problem)
    rest = text.split("\n")[int(place[1]) - 1][int(place[2]) - 1 :] if place else ""
    number = re.match(r"[+-]?(\.\d+)", rest)
    return f"; numbers begin with a digit: 0{number[1]}" if number else ""


def record_from(table: Mapping[str, Any], kind: type[Record], *, path: str | Path | None = None) -> Record:
    """A dataclass, and those within it, from a nested table. InputError names the file, the key and the cure."""
    for name, known in unknown_keys(table, kind):
        nearest = difflib.get_close_matches(name.rpartition(".")[2], known, n=1, cutoff=0.5)
        cure = f"did you mean '{nearest[0]}'?" if nearest else f"known are: {', '.join(known)}"
        raise InputError(f"unknown option; {cure}", path=path, field=name)
    return converted(table, kind, path=path)


def converted(
    table: Mapping[str, Any], kind: type[Record], *, path: str | Path | None = None, within: str = ""
) -> Record:
    """A record from a nested table, which is itself `within` a key. InputError names the file and the key."""
    try:
        return msgspec.convert(table, kind, dec_hook=_path)
    except msgspec.ValidationError as error:
        problem, key = told_by(error)
    except InputError as error:
        problem, key = error.problem, error.field or ""
    dot = "." if within and key and not key.startswith("[") else ""
    raise InputError(problem, path=path, field=within + dot + key or None)


def told_by(error: msgspec.ValidationError) -> tuple[str, str]:
    """What msgspec finds wrong, and the key where, as robot[0].name."""
    problem, _, place = str(error).partition(" - at ")
    return problem.replace("`", "'"), place.strip("`").removeprefix("$").removeprefix(".")


def _path(kind: type, value: Any) -> Any:
    """A value of a kind that TOML does not know: of these records, a path, or anything at all."""
    if isinstance(value, kind):
        return value
    if not isinstance(value, str):
        raise ValueError(f"Expected a path, found {value!r}")
    return kind(value)


def unknown_keys(table: Mapping[str, Any], record: type) -> Iterator[tuple[str, list[str]]]:
    """The keys of a nested table that a record has no field for, with the names of the fields there are."""
    hints = get_type_hints(record)
    known = [f.name for f in fields(record)]
    for name, value in table.items():
        if name not in known:
            yield name, known
            continue
        inner = next((t for t in (hints[name], *get_args(hints[name])) if is_dataclass(t)), None)
        if inner is not None and isinstance(value, Mapping):
            yield from ((f"{name}.{deeper}", names) for deeper, names in unknown_keys(value, cast(type, inner)))

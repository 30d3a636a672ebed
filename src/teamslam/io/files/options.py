"""Options of a reader: names and values that people gave, checked against the reader's own record of options."""

import difflib
from collections.abc import Mapping
from dataclasses import fields
from typing import TypeVar, get_origin, get_type_hints

from teamslam.errors import InputError

Record = TypeVar("Record")


def options_of(record: type[Record], given: Mapping[str, object] | None, *, reader: str) -> Record:
    """The frozen record of options with what was given in it.

    InputError for a name that the reader does not know (with the nearest that it does) and for a value of the wrong
    type; whole numbers do for a float.
    """
    kinds = get_type_hints(record)
    names = [f.name for f in fields(record)]  # type: ignore[arg-type]
    checked: dict[str, object] = {}
    for name, value in (given or {}).items():
        if name not in names:
            near = difflib.get_close_matches(name, names, 1)
            hint = f"did you mean '{near[0]}'?" if near else f"it knows {', '.join(names) or 'none'}"
            raise InputError(f"the {reader} reader has no option '{name}'; {hint}", field=name)
        kind = get_origin(kinds[name]) or kinds[name]
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if not isinstance(value, kind) or (kind is not bool and isinstance(value, bool)):
            raise InputError(f"expected {kind.__name__}, found {value!r}", field=name)
        checked[name] = value
    return record(**checked)

"""Whole numbers on the command line: 2.7 robots are a mistake, and not three."""

from collections.abc import Sequence
from typing import Annotated, Any

from cyclopts import Parameter


def whole(kind: Any, tokens: Sequence[Any]) -> Any:
    """The whole number, or numbers, in the words of an option. ValueError names the one that is none."""
    found = []
    for token in tokens:
        try:
            found.append(int(token.value))
        except ValueError:
            raise ValueError(f'expected a whole number, found "{token.value}"') from None
    return tuple(found) if "tuple" in str(kind) else found[0]


Whole = Annotated[int, Parameter(converter=whole)]
MaybeWhole = Annotated[int | None, Parameter(converter=whole)]
Wholes = Annotated[tuple[int, ...], Parameter(converter=whole, negative="")]

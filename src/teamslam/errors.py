"""One family of errors. Everything that teamslam raises on purpose is a `TeamslamError`:

    TeamslamError
    ├── InputError          a file, table or option that cannot be read as it stands (names file, line, field, cure)
    ├── ModelError          data that contradict themselves: unknown keys, wrong shapes, a covariance that is none
    ├── SolveError          the estimate does not exist or was not reached (names the variables)
    └── MissingExtraError   an optional package is not installed (names the extra to install)

A message says what was found, what was expected, and what to try.
"""

from pathlib import Path


class TeamslamError(Exception):
    """Any error that teamslam raises on purpose."""


class InputError(TeamslamError):
    """Something the user handed over cannot be read as it stands.

    `path`, `line` (1-based) and `field` say where; the message says what was found, what was expected, what to try.
    """

    def __init__(
        self, problem: str, *, path: str | Path | None = None, line: int | None = None, field: str | None = None
    ) -> None:
        self.problem, self.path, self.line, self.field = problem, path, line, field
        place = [str(path)] if path is not None else []
        if line is not None:
            place.append(f"line {line}")
        if field is not None:
            place.append(f"field '{field}'")
        super().__init__(f"{', '.join(place)}: {problem}" if place else problem)


class ModelError(TeamslamError):
    """Data that contradict themselves: unknown keys, wrong shapes, a covariance that is none."""


class SolveError(TeamslamError):
    """The estimate does not exist or was not reached; the message names the variables concerned, `key` the first."""

    def __init__(self, problem: str, *, key: int | None = None) -> None:
        self.key = key
        super().__init__(problem)


class MissingExtraError(TeamslamError):
    """An optional package is needed and absent; the message names the extra that brings it."""


def in_words(name: str) -> str:
    """A name within a sentence: one line, in which what cannot be printed shows its code."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in name)

"""What a misfit looks like, in words."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Cause:
    """A sentence that a test on the data itself has found true, and the share of the excess cost that it `explains`
    where it was tested. `robots` are those concerned; `kind` is what it is called in scripts."""

    kind: str
    sentence: str
    explains: float
    robots: tuple[int, ...] = ()

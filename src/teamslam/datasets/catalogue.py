"""The public data sets that the pages use, as `sets.toml` beside this file states them.

None of them is part of teamslam. Checksums are of the files of the copy that was measured with, not of an archive: who
packs them, and how, differs from place to place.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache
from pathlib import Path

from teamslam.errors import InputError


@dataclass(frozen=True)
class PublicSet:
    """One data set: what it holds, whose it is, where it is and under which terms, and how to map it.

    `folder` is what its folder is called where it is published. `sha256` holds the digest of each file, by its name in
    the folder; of a name with a star, the digest of what `sha256sum` prints for all files that it fits, in order.
    Empty where no copy was at hand. In a command, `{path}` stands for the folder that holds the files.
    """

    name: str
    holds: str
    by: str
    licence: str
    page: str
    get: str
    format: str
    command: str
    folder: str = ""
    file: str = ""
    note: str = ""
    also: str = ""
    bytes: int | None = None
    sha256: Mapping[str, str] = field(default_factory=dict)

    def commands(self, path: Path | str) -> list[str]:
        """What to run once it is in a folder."""
        return [words.replace("{path}", str(path)) for words in (self.command, self.also) if words]


@cache
def public_sets() -> tuple[PublicSet, ...]:
    """All of them, in the order of the file."""
    text = Path(__file__).with_name("sets.toml").read_text(encoding="utf-8")
    return tuple(PublicSet(**row) for row in tomllib.loads(text)["set"])


def by_name(name: str) -> PublicSet:
    """The set of a name. InputError names those that there are, or the nearest one."""
    sets = {found.name: found for found in public_sets()}
    if name in sets:
        return sets[name]
    near = get_close_matches(name, sets, 1)
    hint = f"did you mean '{near[0]}'?" if near else f"there are {', '.join(sets)}"
    raise InputError(f"no data set is called '{name}'; {hint}")

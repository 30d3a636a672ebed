"""`teamslam data`: the public data sets that the pages use, and downloads of them unpacked."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from teamslam.cli.voice import spoken

if TYPE_CHECKING:
    from teamslam.datasets import Found, PublicSet

UNKNOWN = "none: no copy was at hand"


def listed(name: str | None = None, /) -> int:
    """List the public data sets that the pages and the README use, where each is, and how to map it.

    ```
    teamslam data                    # all of them
    teamslam data mrclam_6           # one: whose it is, where it is, its terms and checksums
    teamslam data unpack MRCLAM6.zip --out MRCLAM_Dataset6
    ```

    None of them is part of teamslam, and none is fetched from here: the page of the publisher has the download.

    Exit codes: 0 done; 2 there is no such data set.

    Parameters
    ----------
    name
        Of one data set, for all that is known of it.
    """
    from teamslam.cli.console import answer, say, table
    from teamslam.datasets import by_name, public_sets

    if name is not None:
        _tell(by_name(name))
        return 0
    rows = [[found.name, found.holds, found.format, _size(found), found.page] for found in public_sets()]
    table("public data sets", ("name", "holds", "format", "size", "where"), rows, left=5)
    say("One of them: teamslam data NAME. A download: teamslam data unpack FILE --out DIR")
    answer({"sets": [_document(found) for found in public_sets()]})
    return 0


def unpack(file: Path, /, *, out: Annotated[Path, Parameter(alias="-o")]) -> int:
    """Unpack a download of a data set, compare its files with those that were measured with, and say what to run next.

    ```
    teamslam data unpack MRCLAM6.zip --out data/MRCLAM_Dataset6
    teamslam data unpack tagslam_test-master.zip --out tags
    ```

    Takes zip, tar (also compressed) and single compressed files; compressed files inside are undone as well.

    Exit codes: 0 done; 1 unpacked, but files of the data set differ from those that were measured with, or are not
    there; 2 no archive, or a damaged one: nothing is written.

    Parameters
    ----------
    file
        The archive, as it was downloaded.
    out
        The folder to unpack into; it must not exist, or be empty.
    """
    from teamslam.cli.codes import DONE, PARTLY
    from teamslam.cli.console import answer, say
    from teamslam.datasets import found_in, readable_in
    from teamslam.datasets import unpack as unpack_archive

    files = unpack_archive(file, out)
    sets = found_in(out)
    say(f"unpacked: {len(files)} file{'s' if len(files) != 1 else ''} into {out}")
    for found in sets:
        _say_found(found)
    other = None if sets else readable_in(out)
    if not sets:
        said = "none of the data sets that `teamslam data` lists, by its files"
        say(f"{said}; next: teamslam info {other}" if other else f"{said}, and nothing in it that teamslam reads")
    answer({"folder": str(out), "files": len(files), "sets": [_found(found) for found in sets], "other": other})
    return PARTLY if any(found.differ or found.missing for found in sets) else DONE


def _tell(found: "PublicSet") -> None:
    """All that is known of a set."""
    from teamslam.cli.console import answer, pairs

    digests = list(found.sha256.items()) or [("files", UNKNOWN)]
    facts = [("holds", found.holds), ("by", found.by), ("licence", found.licence), ("page", found.page)]
    facts += [("get it", found.get), ("size", _size(found)), ("format", found.format)]
    facts += [("note", found.note)] if found.note else []
    facts += [("then", command) for command in found.commands(found.folder or ".")]
    pairs(found.name, facts)
    pairs("SHA-256 of the files that were measured with", digests)
    answer(_document(found))


def _say_found(found: "Found") -> None:
    """What is there of a set, and what to run."""
    from teamslam.cli.console import say

    known = found.known
    say(f"{known.name}: {known.holds}")
    if not known.sha256:
        say("  not compared: no checksums of it are known here")
    else:
        say(f"  {len(found.same)} of {len(known.sha256)} checksums are those that were measured with")
    for word, names in (("differ", found.differ), ("are not there", found.missing)):
        if names:
            say(f"  {word}: {', '.join(names)}")
    for command in known.commands(found.folder):
        say(f"  next: {command}")


def _found(found: "Found") -> dict[str, object]:
    return {
        "name": found.known.name,
        "folder": str(found.folder),
        "same": found.same,
        "differ": found.differ,
        "missing": found.missing,
        "next": found.known.commands(found.folder),
    }


def _document(found: "PublicSet") -> dict[str, object]:
    return {name: dict(value) if name == "sha256" else value for name, value in vars(found).items()}


def _size(found: "PublicSet") -> str:
    return "unknown" if found.bytes is None else f"{found.bytes / 1e6:.1f} MB"


data = App(name="data", help=listed.__doc__, help_format="markdown")
data.default(spoken(listed))
data.command(spoken(unpack))

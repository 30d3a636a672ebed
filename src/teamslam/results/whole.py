"""Folders that are whole or not there: written as a draft beside their place, and moved there when they are complete.

Where the folder is there already and cannot be moved away (a mount point, the folder that one stands in, one in a
folder that may not be written), it is filled: the draft lies inside, and its files are moved up at the end.
"""

import os
import shutil
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from teamslam.errors import InputError
from teamslam.io.files.whole import beside


def made_folder(folder: Path) -> Path:
    """A folder to write into, made where it is absent. InputError where it cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise InputError("the output is a file; expected a folder", path=folder) from None
    except OSError as error:
        raise InputError(f"the output folder cannot be made: {error.strerror or error}", path=folder) from None
    return folder


def refuse_to_overwrite(
    folder: Path, *, replace: bool | None, ours: Collection[str] = (), inputs: Sequence[Path] = ()
) -> None:
    """Raise InputError where writing to `folder` would destroy something that is not an earlier run.

    `replace`: whether an earlier run may be replaced; None where the command knows no such thing. `ours`: what a run
    writes; a folder that holds anything else is left alone. `inputs` must not lie in what is replaced.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError("the output is a file; expected a folder to make", path=folder)
    held = sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []
    if not held:
        return
    if not replace:
        cure = (
            "choose another, or empty it"
            if replace is None
            else "choose another, or replace it with --force (in a script: replace=True)"
        )
        raise InputError(f"the output folder is not empty; {cure}", path=folder)
    if not is_run(folder):
        raise InputError("the output folder holds something that is no run; it is left alone", path=folder)
    if strangers := [name for name in held if name not in ours]:
        some = ", ".join(strangers[:3]) + (", ..." if len(strangers) > 3 else "")
        raise InputError(f"the output folder holds {some}, which no run writes; move that away first", path=folder)
    for path in inputs:
        if path.resolve().is_relative_to(folder.resolve()):
            raise InputError(f"the output folder holds the input {path}; choose another", path=folder)


def is_run(path: str | Path) -> bool:
    """True for a folder that holds a run."""
    return (Path(path) / "report.json").is_file() and (Path(path) / "maps").is_dir()


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """A draft folder that takes the place of `folder` once everything in it is written, and vanishes on any error.

    InputError where no folder can be made there; an OSError inside names the file by its place in `folder`.
    """
    place = Path(os.path.realpath(folder))
    inside = place.exists() and not _can_be_moved(place)
    draft = beside(place / "draft") if inside else beside(place)
    try:
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            draft.mkdir()
        except OSError as error:
            raise InputError(f"the output folder cannot be made: {error.strerror or error}", path=folder) from None
        yield draft
        _fill(place, draft) if inside else _take_place(place, draft)
    except OSError as error:
        error.filename = _in_place(error.filename, draft, folder)
        raise
    except InputError as error:
        raise InputError(
            error.problem, path=_in_place(error.path, draft, folder), line=error.line, field=error.field
        ) from None
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _in_place(name: object, draft: Path, folder: Path) -> Any:
    """The name of a file of the draft as it will be; others as they are."""
    if isinstance(name, str | Path) and Path(name).is_relative_to(draft):
        return str(folder / Path(name).relative_to(draft))
    return name


def _can_be_moved(place: Path) -> bool:
    here = Path.cwd()
    return os.access(place.parent, os.W_OK) and not os.path.ismount(place) and not here.is_relative_to(place)


def _take_place(place: Path, draft: Path) -> None:
    """Put the draft where an earlier folder may be, which is away for no longer than a moment."""
    if not place.exists():
        draft.rename(place)
        return
    old = beside(place)
    try:
        place.rename(old)
        draft.rename(place)
    finally:
        if old.exists() and not place.exists():
            old.rename(place)
        shutil.rmtree(old, ignore_errors=True)


def _fill(place: Path, draft: Path) -> None:
    """Put the draft's files into the folder in place of all that is there; report.json, which makes a run, last."""
    for entry in place.iterdir():
        if entry != draft:
            shutil.rmtree(entry) if entry.is_dir() and not entry.is_symlink() else entry.unlink()
    for entry in sorted(draft.iterdir(), key=lambda entry: entry.name == "report.json"):
        entry.rename(place / entry.name)

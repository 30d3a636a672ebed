"""Files that are whole or not there: written beside their place, and moved there once they are complete.

So whoever finds a file may trust it, also after a kill, and whoever may read the folder may read what is new in it.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4


def beside(path: Path) -> Path:
    """A name for a draft in the same folder that nobody else uses."""
    return path.with_name(f".{path.name}.{uuid4().hex}.part")


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A draft that takes the place of `path` at the end, and vanishes on any error. Its folder is made.

    An OSError names `path`.
    """
    draft = beside(path)
    with named(path, draft):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with draft.open("xb") as file:
                yield file
            os.replace(draft, path)
        except BaseException:
            draft.unlink(missing_ok=True)
            raise


@contextmanager
def named(path: Path, draft: Path | None = None) -> Iterator[None]:
    """An OSError inside that names no file, as one of a full disk, or the draft of this one, names `path`."""
    try:
        yield
    except OSError as error:
        if error.filename is None or error.filename == str(draft):
            raise OSError(error.errno, error.strerror or str(error), str(path)) from None
        raise

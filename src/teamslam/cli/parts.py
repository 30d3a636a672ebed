"""Workers, and the parts that they make: beside the output until all is done, so that an interrupted call goes on."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teamslam.scale import Workers


def workers_for(count: int | None, cluster: str | None) -> "Workers | None":
    """The workers that were asked for, None where none were. InputError where both kinds were, and, before any work is
    done or written, where no scheduler answers."""
    from teamslam.errors import InputError
    from teamslam.scale import Cluster, Processes

    if count is not None and cluster is not None:
        raise InputError("give --workers for processes of this machine, or --cluster for those of a cluster, not both")
    if cluster is not None:
        workers = Cluster(cluster)
        workers.open().shutdown()
        return workers
    return None if count is None else Processes(count)


@contextmanager
def parts_beside(out: Path, workers: "Workers | None") -> Iterator[Path | None]:
    """The folder OUT.parts, gone when all is done; what ends before then says that it goes on from there. None without
    workers."""
    from shutil import rmtree

    from teamslam.cli.console import complain

    if workers is None:
        yield None
        return
    parts = out.absolute().with_name(f"{out.absolute().name}.parts")
    goes_on = f"what is done lies in {parts}; the same command goes on from there"
    try:
        yield parts
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"interrupted; {goes_on}") from None
    except OSError:
        complain(goes_on)
        raise
    rmtree(parts, ignore_errors=True)

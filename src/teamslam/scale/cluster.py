"""Workers: where the tasks of a big join run.

    Processes(4)              processes of this machine (concurrent.futures), the default
    Cluster("tcp://host:8786")   a dask.distributed scheduler, from `pip install teamslam[cluster]`

A task is a function of the module level and one picklable argument; what it makes it leaves on disk, where the other
workers find it. So a worker may be killed at any moment: its tasks are run again, and those that had finished only
look at their files. Each task has one thread of the kernel and of BLAS to itself, as there are as many tasks as
processors.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from teamslam.errors import InputError, MissingExtraError, SolveError
from teamslam.kernel import set_threads

Job = TypeVar("Job")
Result = TypeVar("Result")

DEATHS = 3  # pools that may break one after another without one task finishing in between
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class Workers(Protocol):
    """Where tasks run."""

    def open(self) -> Executor:
        """An executor that takes tasks. Raises InputError or MissingExtraError where there can be none."""


@dataclass(frozen=True)
class Processes:
    """`count` processes of this machine; None: one for each processor.

    They start afresh (spawn), so a script that uses them needs `if __name__ == "__main__":` around its calls.
    """

    count: int | None = None

    def __post_init__(self) -> None:
        if self.count is not None and self.count < 1:
            raise InputError(f"at least one worker is needed, found {self.count}", field="workers")

    def open(self) -> Executor:
        """A pool of processes."""
        fresh = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self.count, mp_context=fresh, initializer=_leave_with_parent)


@contextmanager
def _deaf() -> Iterator[None]:
    """Processes that are started inside do not hear a Ctrl-C until they can do without a traceback; their parent hears
    it a moment later."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _leave_with_parent() -> None:
    """A worker dies of a Ctrl-C at once, and says nothing: its parent does. One whose parent was killed would wait for
    it for ever; so one thread watches, and ends the process."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@dataclass(frozen=True)
class Cluster:
    """The workers of the dask.distributed scheduler at `address`. They need teamslam, and the folder of the join under
    the same path."""

    address: str

    def open(self) -> Executor:
        """An executor on the cluster."""
        try:
            from distributed import Client
        except ImportError:
            raise MissingExtraError(
                "a cluster needs the package distributed; install it with `pip install teamslam[cluster]`"
            ) from None
        try:
            client = Client(self.address, timeout="10s", set_as_default=False)  # type: ignore[no-untyped-call]
        except (OSError, ValueError) as error:
            raise InputError(f"no dask scheduler answers at {self.address}: {error}", field="cluster") from None
        return _ClusterExecutor(client)


class _ClusterExecutor(Executor):
    """Dask's executor together with the client that belongs to it."""

    def __init__(self, client: Any) -> None:
        self._client, self._executor = client, client.get_executor(pure=False, retries=DEATHS)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        return self._executor.submit(fn, *args, **kwargs)  # type: ignore[no-any-return]

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._executor.shutdown(wait=wait and not cancel_futures)
        self._client.close()


@contextmanager
def crew(workers: Workers) -> Iterator["Crew"]:
    """Workers that stay for several rounds of tasks, and leave at the end."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # read by the BLAS of a process when it starts
    team = Crew(workers)
    try:
        yield team
    finally:
        team.dismiss()
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.__setitem__(name, value)


class Crew:
    """Runs tasks on workers, and again where a worker died."""

    def __init__(self, workers: Workers) -> None:
        self._workers = workers
        self._executor: Executor | None = None

    def each(
        self, function: Callable[[Job], Result], jobs: Sequence[Job], tell: Callable[[int, int], None] | None = None
    ) -> list[Result]:
        """function(job) of every job, in their order; `tell` hears how many are done, and of how many.

        An error that a task raises is raised here. Raises SolveError where workers die again and again.
        """
        done: dict[int, Result] = {}
        deaths = 0
        while len(done) < len(jobs):
            before = len(done)
            try:
                self._round(function, jobs, done, tell)
            except BrokenExecutor as error:
                self.dismiss()
                deaths = deaths + 1 if len(done) == before else 0
                if deaths >= DEATHS:
                    raise SolveError(
                        f"workers died {deaths} times in a row, with {len(jobs) - len(done)} of {len(jobs)} tasks "
                        f"left ({error}); memory may be short: use fewer workers or shorter pieces. "
                        f"What is finished stays, the same call goes on from there"
                    ) from None
        return [done[number] for number in range(len(jobs))]

    def dismiss(self) -> None:
        """Send the workers home; tasks that wait are dropped."""
        if self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)
            self._executor = None

    def _round(
        self,
        function: Callable[[Job], Result],
        jobs: Sequence[Job],
        done: dict[int, Result],
        tell: Callable[[int, int], None] | None,
    ) -> None:
        if self._executor is None:
            self._executor = self._workers.open()
        left = [number for number in range(len(jobs)) if number not in done]
        with _deaf():
            running = {self._executor.submit(_alone, function, jobs[number]): number for number in left}
        for future in as_completed(running):
            try:
                done[running[future]] = future.result()
            except Exception as error:
                if type(error).__name__ == "KilledWorker":  # of distributed, which need not be installed
                    raise BrokenExecutor(str(error)) from None
                for waiting in running:
                    waiting.cancel()
                raise
            if tell is not None:
                tell(len(done), len(jobs))


def _alone(function: Callable[[Job], Result], job: Job) -> Result:
    """One task on a worker."""
    set_threads(1)
    return function(job)

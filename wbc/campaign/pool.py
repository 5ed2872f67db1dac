"""Work in processes that may die without taking anything with them.

`concurrent.futures` gives up as a whole when one of its processes dies. Here each process has a
pipe of its own, so that it is known which task it was at: that task is tried again in a new
process, and given up after some deaths. Tasks that were not in the process are not touched.
"""

from __future__ import annotations

import contextlib
import multiprocessing as mp
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any, Final, Generic, TypeVar, final

from wbc.campaign.trial import ATTEMPTS
from wbc.errors import WbcError

T = TypeVar("T")
R = TypeVar("R")

_SINGLE: Final = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_PATIENCE: Final = 0.2  # between two looks at `stopped` [s]
_LIFE: Final = 50  # tasks after which a process is replaced: its memory grows by 12 MB a trial
_STILLBORN: Final = 5  # processes in a row that die before they are ready: it is not the task


def in_processes(
    work: Callable[[T], R], tasks: Sequence[T], workers: int, stopped: Callable[[], bool]
) -> Generator[tuple[T, R | None]]:
    """Do the tasks, several at a time, one thread each.

    Args:
        work: a function of a module; what it raises counts as a death of its process.
        tasks: in the order in which they are begun.
        workers: how many at a time.
        stopped: asked now and then; once true, no more is waited for.

    Yields:
        Task and result as they come; None for a result that cost ATTEMPTS processes. When the
        generator is closed, its processes are gone.

    Raises:
        WbcError: processes cannot be started.
    """
    pool = _Pool(work, tasks)
    try:
        for _ in range(min(workers, len(tasks))):
            pool.start()
        while pool.busy and not stopped():
            yield from pool.collect()
    finally:
        pool.end()


@final
class _Worker:
    """A process, its pipe, and the task it is at."""

    def __init__(self, work: Callable[[Any], Any]) -> None:
        context = mp.get_context("spawn")  # a fork would copy locks of the compiler's threads
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(work, theirs), daemon=True)
        with _environment(_SINGLE), _without_interrupt():
            self.process.start()
        theirs.close()  # so that its end is the pipe's end
        self.ready = False
        self.served = 0
        self.task: int | None = None


@final
class _Pool(Generic[T, R]):
    def __init__(self, work: Callable[[T], R], tasks: Sequence[T]) -> None:
        self._work = work
        self._tasks = tasks
        self._waiting = deque(range(len(tasks)))
        self._deaths = [0] * len(tasks)
        self._stillborn = 0
        self._workers: dict[Connection, _Worker] = {}

    @property
    def busy(self) -> bool:
        return bool(self._waiting) or any(w.task is not None for w in self._workers.values())

    def start(self) -> None:
        try:
            worker = _Worker(self._work)
        except OSError as error:
            raise WbcError(f"no process can be started for a trial: {error.strerror}") from None
        self._workers[worker.pipe] = worker

    def collect(self) -> Iterator[tuple[T, R | None]]:
        """What is there now, after a short wait."""
        for pipe in wait(list(self._workers), _PATIENCE):
            worker = self._workers[pipe]  # type: ignore[index]
            try:
                result = worker.pipe.recv()
            except (EOFError, OSError):  # also in the middle of a message
                yield from self._died(worker)
                continue
            if worker.ready and worker.task is not None:
                yield self._tasks[worker.task], result
                worker.served += 1
                if worker.served >= _LIFE and self._waiting:
                    self._remove(worker)
                    self.start()
                    continue
            worker.ready, worker.task, self._stillborn = True, None, 0
            self._next(worker)

    def _next(self, worker: _Worker) -> None:
        if not self._waiting:
            return
        worker.task = self._waiting.popleft()
        with contextlib.suppress(OSError):  # dead already: its end of the pipe says so
            worker.pipe.send(self._tasks[worker.task])

    def _died(self, worker: _Worker) -> Iterator[tuple[T, R | None]]:
        self._remove(worker)
        if not worker.ready:
            self._stillborn += 1
            if self._stillborn >= _STILLBORN:
                raise WbcError("the processes for the trials end as soon as they are started")
        if worker.task is not None:
            self._deaths[worker.task] += 1
            if self._deaths[worker.task] < ATTEMPTS:
                self._waiting.appendleft(worker.task)
            else:
                yield self._tasks[worker.task], None
        if self._waiting:
            self.start()
            for idle in self._workers.values():
                if idle.ready and idle.task is None:
                    self._next(idle)

    def _remove(self, worker: _Worker) -> None:
        del self._workers[worker.pipe]
        worker.pipe.close()
        worker.process.kill()
        worker.process.join()

    def end(self) -> None:
        for worker in list(self._workers.values()):
            self._remove(worker)


def _serve(work: Callable[[Any], Any], pipe: Connection) -> None:
    """The life of a process: ready, then task by task until the pipe ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the one who started it
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        pipe.send(None)
        while True:
            pipe.send(work(pipe.recv()))


def _end_with_parent() -> None:
    """A trial nobody waits for is not worth its heat."""
    parent = mp.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextlib.contextmanager
def _without_interrupt() -> Iterator[None]:
    """For processes started meanwhile, until they look after Ctrl-C themselves."""
    resource_tracker.ensure_running()  # or it is started next, and lets the signal through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    """For processes started meanwhile: read when their libraries are loaded."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value

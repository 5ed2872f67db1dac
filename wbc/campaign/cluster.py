"""Work on the machines of a dask scheduler.

Everything between client, scheduler and workers is pickled and not authenticated: for machines and
networks that trust each other, or with the TLS of dask's own configuration.
"""

from __future__ import annotations

import queue
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import Any, Final, TypeVar

from wbc.errors import WbcError

T = TypeVar("T")
R = TypeVar("R")

_PATIENCE: Final = 0.2  # between two looks at `stopped` [s]
_CONNECT: Final = 10.0  # [s]


def connect(address: str) -> Any:
    """A client of the scheduler at `address`.

    Raises:
        WbcError: dask is not installed, or the scheduler cannot be reached.
    """
    try:
        from distributed import Client
    except ImportError:
        raise WbcError(
            "--scheduler needs dask.distributed, which is not installed: pip install 'wbc[sweep]'"
        ) from None
    try:
        return Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError, ImportError) as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise WbcError(f"--scheduler {address}: cannot be reached: {reason}") from None


def on_cluster(
    client: Any, work: Callable[[T], R], tasks: Sequence[T], stopped: Callable[[], bool]
) -> Generator[tuple[T, R | None]]:
    """Do the tasks on the workers of a scheduler; the client is closed at the end.

    A task that the scheduler gives up is tried once more when the others are done, alone: it may
    have shared its workers with one that killed them.

    Args:
        client: as `connect` gives it.
        work: a function of a module that the workers have, too.
        stopped: asked now and then; once true, no more is waited for.

    Yields:
        Task and result as they come; None for a task that took its workers with it.

    Raises:
        WbcError: the scheduler is lost, or its workers cannot do the work at all.
    """
    try:
        suspects: list[T] = []
        for task, result, fault in _asked(client, work, tasks, stopped):
            if fault is None:
                yield task, result
            elif _killed(fault):
                suspects.append(task)
            else:
                raise _lost(fault)
        for suspect in suspects:
            for task, result, fault in _asked(client, work, [suspect], stopped):
                if fault is not None and not _killed(fault):
                    raise _lost(fault)
                yield task, result
    finally:
        client.close()


def _killed(fault: BaseException) -> bool:
    from distributed import KilledWorker

    return isinstance(fault, KilledWorker)


def _asked(
    client: Any, work: Callable[[T], R], tasks: Sequence[T], stopped: Callable[[], bool]
) -> Iterator[tuple[T, R | None, BaseException | None]]:
    """Task, result or None, fault or None as they come; those not waited for are cancelled."""
    ended: queue.Queue[Any] = queue.Queue()
    futures = {client.submit(work, task, pure=False): task for task in tasks}
    for future in list(futures):
        future.add_done_callback(ended.put)
    try:
        while futures and not stopped():
            try:
                future = ended.get(timeout=_PATIENCE)
            except queue.Empty:
                continue
            if future.status == "pending":  # its result died with a worker: it is done again
                future.add_done_callback(ended.put)
                continue
            try:
                result, fault = future.result(), None
            except Exception as error:
                result, fault = None, error
            yield futures.pop(future), result, fault
    finally:
        client.cancel(list(futures))


def _lost(fault: BaseException) -> WbcError:
    what = " ".join(f"{type(fault).__name__}: {fault}".split())[:200]
    return WbcError(
        f"--scheduler: no more trials from there: {what} "
        "(what is done is kept: the same command goes on)"
    )

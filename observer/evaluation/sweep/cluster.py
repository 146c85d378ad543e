"""Processes that work on a sweep: dask.distributed, which the extra ``cluster`` installs.

dask is imported only at its first use.
"""

from __future__ import annotations

import importlib.util
import logging
import signal
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from observer.errors import DynamicObserverError, InputError
from observer.evaluation.sweep.task import Outcome, Task, run_task
from observer.extras import package_missing

if TYPE_CHECKING:
    from distributed import Client

_JOINING_S = 30.0
# Tasks submitted ahead per worker, so that no worker waits for its next one.
_AHEAD = 3


class ClusterLost(DynamicObserverError):
    """The cluster was lost during a sweep."""


@dataclass(frozen=True)
class ClusterChoice:
    """Choice of a cluster.

    Attributes:
        scheduler: address of an existing one, e.g. ``tcp://lab-server:8786``; None to start one
            here and stop it after the work.
        workers: number of those started here, with one thread each.
        processes: False to run them as threads of this process.
    """

    scheduler: str | None = None
    workers: int = 1
    processes: bool = True


def cluster_missing() -> str | None:
    """Return one sentence on how to install missing packages for sweeps, or None."""
    missing = [n for n in ("distributed", "pyarrow") if importlib.util.find_spec(n) is None]
    return package_missing("a sweep", "cluster", *missing) if missing else None


@contextmanager
def opened_cluster(choice: ClusterChoice) -> Iterator[Client]:
    """Provide a client of the cluster; a cluster started here ends with the block.

    Raises:
        InputError: distributed is not installed, or no scheduler answers at the address.
    """
    missing = cluster_missing()
    if missing is not None:
        raise InputError(missing)
    with _local(choice) if choice.scheduler is None else _remote(choice.scheduler) as client:
        yield client


def evaluate_tasks(
    client: Client,
    tasks: Iterable[Task],
    done: Callable[[Task, Outcome], None],
    *,
    cache_bytes: int,
    own_process: bool = True,
) -> None:
    """Evaluate the tasks on the cluster, a few submitted ahead.

    Args:
        done: called with each as soon as it is finished, in this thread.

    Raises:
        ClusterLost: the scheduler was lost, or cancelled the tasks.
    """
    from distributed import as_completed

    waiting: dict[str, Task] = {}
    left = iter(tasks)
    finished: Any = as_completed(loop=client.loop)  # type: ignore[no-untyped-call]

    def hand_out() -> None:
        # An existing cluster may have grown meanwhile.
        workers: Any = client.nthreads()  # type: ignore[no-untyped-call]
        while len(waiting) < _AHEAD * max(1, len(workers)):
            task = next(left, None)
            if task is None:
                return
            key = f"sweep-{task.key}"
            if key in waiting:
                raise ValueError("a task is given twice")
            waiting[key] = task
            finished.add(client.submit(run_task, task, cache_bytes, own_process, key=key))

    try:
        hand_out()
        for future in finished:
            done(waiting.pop(future.key), _outcome(future))
            # Let the scheduler forget it.
            future.release()
            hand_out()
    except (OSError, TimeoutError) as error:
        raise ClusterLost(
            "the connection to the cluster's scheduler was lost "
            f"({error or type(error).__name__}); start the sweep again and it continues from there"
        ) from None


def _outcome(future: Any) -> Outcome:
    if future.status == "finished":
        outcome = future.result()
        assert isinstance(outcome, Outcome)
        return outcome
    if future.status in ("cancelled", "lost"):
        raise ClusterLost(
            "the cluster cancelled the tasks; start the sweep again and it continues from there"
        )
    error = future.exception()
    if type(error).__name__ == "KilledWorker":
        return Outcome(
            error="the workers running it died, possibly out of memory; run with fewer jobs"
        )
    return Outcome(error=f"{type(error).__name__}: {error}")


@contextmanager
def _local(choice: ClusterChoice) -> Iterator[Client]:
    from distributed import Client, LocalCluster

    with ExitStack() as stack:
        scratch = stack.enter_context(
            tempfile.TemporaryDirectory(prefix="sweep-", ignore_cleanup_errors=True)
        )
        with _without_interrupts():
            cluster = LocalCluster(  # type: ignore[no-untyped-call]
                n_workers=choice.workers,
                threads_per_worker=1,
                processes=choice.processes,
                # Local only, on free ports, as another sweep may be running.
                host=None if not choice.processes else "127.0.0.1",
                dashboard_address="127.0.0.1:0",
                worker_dashboard_address="127.0.0.1:0",
                local_directory=scratch,
                memory_limit=0,
                silence_logs=logging.CRITICAL,
            )
        stack.callback(cluster.close)
        client = Client(cluster, set_as_default=False)  # type: ignore[no-untyped-call]
        yield stack.enter_context(client)


@contextmanager
def _remote(address: str) -> Iterator[Client]:
    from distributed import Client

    try:
        client = Client(  # type: ignore[no-untyped-call]
            address, set_as_default=False, timeout=_JOINING_S
        )
    except (OSError, TimeoutError, ValueError):
        raise InputError(
            f"no scheduler answers at {address}; start one with `dask scheduler` and give its "
            "address, for example tcp://lab-server:8786"
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=_JOINING_S)
        except TimeoutError:
            raise InputError(
                f"the scheduler at {address} has no workers; start some with `dask worker "
                f"{address} --nthreads 1`"
            ) from None
        yield client


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Let processes started within ignore Ctrl-C, which reaches all processes of the terminal.

    This process stops them after finished results are kept.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)

"""Sweep from its plan to its results."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

from observer.errors import InputError
from observer.evaluation.sweep.cluster import ClusterChoice, evaluate_tasks, opened_cluster
from observer.evaluation.sweep.crowds import SweepCrowd
from observer.evaluation.sweep.grid import Combination, Grid
from observer.evaluation.sweep.results import Row, Sweep
from observer.evaluation.sweep.sources import SweepSource
from observer.evaluation.sweep.store import TaskStore
from observer.evaluation.sweep.task import Outcome, Task, method_version

DEFAULT_CACHE_BYTES = 600_000_000


@dataclass(frozen=True)
class Plan:
    """Plan of a sweep.

    Attributes:
        sources: all of one kind; for a driving grid they are crowds.
        gate_m: highest distance of an instance from its body.
    """

    grid: Grid
    combinations: tuple[Combination, ...]
    sources: tuple[SweepSource | SweepCrowd, ...]
    gate_m: float

    @property
    def count(self) -> int:
        """Number of tasks."""
        return len(self.combinations) * len(self.sources)


@dataclass(frozen=True)
class CoreUse:
    """Use of the time of the processes that were started for a sweep.

    Attributes:
        tasks: number finished. elapsed_s: from before their start until after their end.
        at_work: share of their time spent on tasks; the rest is starting and waiting.
        computing: share of their time in which they had a core, which other processes may take.
    """

    tasks: int
    elapsed_s: float
    at_work: float
    computing: float

    @classmethod
    def of(cls, outcomes: Collection[Outcome], elapsed_s: float, workers: int) -> CoreUse:
        """Compute it from the tasks' own measurements."""
        whole = elapsed_s * workers
        at_work, computing = sum(o.wall_s for o in outcomes), sum(o.cpu_s for o in outcomes)
        return cls(len(outcomes), elapsed_s, at_work / whole, computing / whole)


class SweepRun:
    """Run of a sweep; finished tasks are in the store and in ``result`` at any time.

    Attributes:
        use: of the processes started for it; None before, and if others' processes were used.

    Raises:
        InputError: there is nothing to do, or a source is given twice.
    """

    def __init__(self, plan: Plan, store: TaskStore) -> None:
        if not plan.combinations or not plan.sources:
            raise InputError("a sweep needs at least one combination and one source")
        digests = [s.digest for s in plan.sources]
        for i, source in enumerate(plan.sources):
            if source.digest in digests[:i]:
                raise InputError(f"{source.name} is given twice; give each source once")
        self._plan, self._store = plan, store
        self._version = method_version()
        # Source by source, so that a worker caches few of them at a time.
        self._tasks = [
            (combination, Task(source, combination.parameters, plan.gate_m, self._version))
            for source in plan.sources
            for combination in plan.combinations
        ]
        self._outcomes: dict[str, Outcome] = {}
        for _, task in self._tasks:
            found = store.find(task)
            if found is not None:
                self._outcomes[task.key] = found
        self.kept = sum(task.key in self._outcomes for _, task in self._tasks)
        self.use: CoreUse | None = None

    def run(
        self,
        cluster: ClusterChoice,
        *,
        cache_bytes: int = DEFAULT_CACHE_BYTES,
        progress: Callable[[int, int], None] | None = None,
    ) -> None:
        """Evaluate the tasks that no earlier sweep finished; each result is kept immediately.

        Args:
            cache_bytes: of frames that each worker caches.
            progress: called with the number of tasks done and their total.

        Raises:
            InputError: the cluster cannot be opened, or a result cannot be written.
            ClusterLost: the cluster was lost.
        """
        # Combinations may have the same parameters, which are evaluated once.
        elsewhere = cluster.scheduler is not None
        open_tasks = {
            t.key: replace(t, elsewhere=elsewhere)
            for _, t in self._tasks
            if t.key not in self._outcomes
        }
        alike = Counter(task.key for _, task in self._tasks)
        total, done = len(self._tasks), self.kept
        new: list[Outcome] = []
        began = time.perf_counter()

        def finished(task: Task, outcome: Outcome) -> None:
            nonlocal done
            new.append(outcome)
            self._outcomes[task.key] = outcome
            self._store.keep(task, outcome)
            done += alike[task.key]
            if progress is not None:
                progress(done, total)

        if progress is not None:
            progress(done, total)
        if not open_tasks:
            return
        with opened_cluster(cluster) as client:
            evaluate_tasks(
                client,
                open_tasks.values(),
                finished,
                cache_bytes=cache_bytes,
                own_process=cluster.processes,
            )
        if not elsewhere and cluster.processes:
            self.use = CoreUse.of(new, time.perf_counter() - began, cluster.workers)

    @property
    def result(self) -> Sweep:
        """Results so far."""
        return Sweep(
            grid=self._plan.grid,
            sources=self._plan.sources,
            combinations=self._plan.combinations,
            rows=tuple(
                Row(combination, task.source, self._outcomes.get(task.key))
                for combination, task in self._tasks
            ),
            gate_m=self._plan.gate_m,
            version=self._version,
            kept=self.kept,
        )

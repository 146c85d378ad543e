"""Benchmark of driving to a goal among people: selection and execution of the runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, as_completed
from dataclasses import dataclass, field

from observer.errors import InputError
from observer.evaluation.jobs import use_one_core, worker_pool
from observer.evaluation.navigation.coverage import Walk, WalkResult, follow
from observer.evaluation.navigation.crowd import crowd_missing
from observer.evaluation.navigation.oracle import Answer, Question, ask
from observer.evaluation.navigation.results import NavigationBenchmark, coverages, summarize
from observer.evaluation.navigation.run import DRIVERS, Case, RunResult, run
from observer.navigation.parameters import AllParameters

Task = Case | Walk | Question
Result = RunResult | WalkResult | Answer


@dataclass(frozen=True)
class Choice:
    """Selection of runs to measure.

    Attributes:
        runs: number of runs per setting, with seeds from ``seed`` on. kinds: True for people who
            avoid the robot. risks: declared per metre.
        image_runs: number of runs of the planner at every density and risk that use images, among
            people who do not avoid the robot.
        parameters: of guard and planner.
    """

    runs: int
    densities: tuple[float, ...]
    kinds: tuple[bool, ...]
    risks: tuple[float, ...]
    seed: int
    image_runs: int = 0
    parameters: AllParameters = field(default_factory=AllParameters)

    def cases(self) -> tuple[Case, ...]:
        """Return all runs; the guard alone runs at one risk only, as it does not use it."""
        modelled = tuple(
            Case(driver, density, kind, risk, seed)
            for kind in self.kinds
            for density in self.densities
            for driver in DRIVERS
            for risk in (self.risks if driver == "planner" else self.risks[:1])
            for seed in range(self.seed, self.seed + self.runs)
        )
        return modelled + tuple(
            Case("planner", density, False, risk, seed, "images")
            for density in self.densities
            for risk in self.risks
            for seed in range(self.seed, self.seed + self.image_runs)
        )

    def walks(self) -> tuple[Walk, ...]:
        """Return the walks on which predictions are evaluated."""
        return tuple(Walk(*each) for each in self._crowds(self.runs))

    def questions(self) -> tuple[Question, ...]:
        """Return the crowds for the oracle, which does not exist for people who avoid the robot."""
        runs = max(self.runs if False in self.kinds else 0, self.image_runs)
        return tuple(Question(*each) for each in self._crowds(runs))

    def _crowds(self, runs: int) -> list[tuple[float, int]]:
        seeds = range(self.seed, self.seed + runs)
        return [(density, seed) for density in self.densities for seed in seeds]


def measure(
    choice: Choice, jobs: int, progress: Callable[[int, int | None], None]
) -> NavigationBenchmark:
    """Make all runs; the results do not depend on the number of processes.

    Args:
        jobs: number of processes. progress: called with the number of runs done and their total.

    Raises:
        InputError: JuPedSim is not installed.
        WorkerLost: a process was killed, e.g. by the system for lack of memory.
    """
    missing = crowd_missing()
    if missing is not None:
        raise InputError(missing)
    tasks: list[Task] = [*choice.cases(), *choice.walks(), *choice.questions()]
    done = _in_processes(tasks, choice.parameters, jobs, progress)
    runs = [each for each in done if isinstance(each, RunResult)]
    walked = [each for each in done if isinstance(each, WalkResult)]
    answers = [each for each in done if isinstance(each, Answer)]
    return NavigationBenchmark(
        choice.seed,
        summarize(runs, answers),
        coverages(walked),
        AllParameters().difference(choice.parameters),
    )


def _in_processes(
    tasks: Sequence[Task],
    parameters: AllParameters,
    jobs: int,
    progress: Callable[[int, int | None], None],
) -> list[Result]:
    progress(0, len(tasks))
    results: list[Result] = []
    if jobs == 1:
        for task in tasks:
            results.append(_done(task, parameters))
            progress(len(results), len(tasks))
        return results
    with worker_pool(min(jobs, len(tasks)), use_one_core) as pool:
        futures: list[Future[Result]] = [pool.submit(_done, task, parameters) for task in tasks]
        for number, each in enumerate(as_completed(futures), 1):
            each.result()
            progress(number, len(tasks))
        return [each.result() for each in futures]


def _done(task: Task, parameters: AllParameters) -> Result:
    match task:
        case Case():
            return run(task, parameters)
        case Walk():
            return follow(task, parameters.navigation)
        case Question():
            return ask(task, parameters.guard)

"""Growth of processes over hours: memory, threads, descriptors, and whether a slope is more than
noise.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
from scipy.stats import t as student

from observer.geometry import Float64Array

# Parts of a process's memory in proc(5) that only the process itself makes grow: file pages, such
# as libraries, are left out, because the system loads and drops them as it likes.
_OWN_MEMORY = ("RssAnon", "RssShmem", "VmSwap")
_READINGS, _READING_INTERVAL_S = 5, 0.1
# Fewer samples have no slope worth judging.
LEAST_SAMPLES = 8
_CONFIDENCE = 0.95
# A higher correlation cannot be distinguished from a trend.
_MOST_CORRELATION = 0.9


@dataclass(frozen=True)
class ProcessUse:
    """Resources held by one process.

    Attributes:
        memory_mb: resident or swapped, without pages of files; MiB.
        threads, descriptors: their numbers.
    """

    memory_mb: float
    threads: int
    descriptors: int


def process_use(pid: int) -> ProcessUse:
    """Read what a process holds; Linux only.

    Raises:
        OSError: there is no such process, or no ``/proc``.
    """
    folder = Path("/proc", str(pid))
    lines = (line.partition(":") for line in (folder / "status").read_text().splitlines())
    status = {name: value.split() for name, _, value in lines}
    kilobytes = sum(int(status[name][0]) for name in _OWN_MEMORY)
    return ProcessUse(kilobytes / 1024, int(status["Threads"][0]), len(os.listdir(folder / "fd")))


def steady_use(pids: Mapping[str, int]) -> dict[str, ProcessUse]:
    """Read what processes hold, several times within half a second.

    Memory is the median; of threads and descriptors, some of which come and go with each request,
    the least is taken.

    Raises:
        OSError: one of the processes is gone.
    """
    readings: list[dict[str, ProcessUse]] = []
    for _ in range(_READINGS):
        readings.append({name: process_use(pid) for name, pid in pids.items()})
        time.sleep(_READING_INTERVAL_S)
    return {
        name: ProcessUse(
            median(each[name].memory_mb for each in readings),
            min(each[name].threads for each in readings),
            min(each[name].descriptors for each in readings),
        )
        for name in pids
    }


@dataclass(frozen=True)
class Slope:
    """Straight line through samples over time.

    Attributes:
        per_hour: its slope. std: standard error of the slope, which allows for samples that
            correlate with the one before.
        count: samples.
    """

    per_hour: float
    std: float
    count: int

    @property
    def margin(self) -> float:
        """Return half of the slope's 95 % interval."""
        return float(student.ppf((1 + _CONFIDENCE) / 2, self.count - 2)) * self.std

    def within(self, limit: float) -> bool | None:
        """Judge the slope: true if the whole 95 % interval lies within the limit.

        False if the slope exceeds the limit and its interval excludes 0; None if the samples are
        too few or too noisy to tell.
        """
        if self.per_hour + self.margin <= limit:
            return True
        return False if self.per_hour > limit and self.per_hour - self.margin > 0 else None


def slope(
    hours: Sequence[float] | Float64Array, values: Sequence[float] | Float64Array
) -> Slope | None:
    """Fit a straight line by least squares; None for fewer than ``LEAST_SAMPLES``.

    Memory wanders: if one sample is above the line, the next one tends to be too. The standard
    error of independent samples is widened accordingly, by the residuals' correlation with their
    predecessors.
    """
    if len(values) < LEAST_SAMPLES:
        return None
    x = np.asarray(hours) - np.mean(hours)
    y = np.asarray(values, dtype=np.float64)
    spread = float(x @ x)
    per_hour = float(x @ y) / spread
    residuals = y - y.mean() - per_hour * x
    squares = float(residuals @ residuals)
    std = (squares / (len(y) - 2) / spread) ** 0.5
    correlation = float(residuals[1:] @ residuals[:-1]) / squares if squares else 0.0
    correlation = min(max(correlation, 0.0), _MOST_CORRELATION)
    return Slope(per_hour, std * ((1 + correlation) / (1 - correlation)) ** 0.5, len(y))


def grows(counts: Sequence[int]) -> bool:
    """Return whether a number of threads or descriptors grew: the minimum of its last third exceeds
    the maximum of its first third.
    """
    third = len(counts) // 3
    return third > 0 and min(counts[-third:]) > max(counts[:third])

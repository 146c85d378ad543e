"""A soak test finds growth, and nothing else; a real server passes a short one."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import psutil
import pytest

from tools.benchmark.process_growth import ProcessUse, grows, process_use, slope, steady_use
from tools.benchmark.soak import Evening, SoakFigures, soak_figures
from tools.benchmark.soak_report import soak_markdown

if not sys.platform.startswith("linux"):
    pytest.skip("processes are looked at through Linux's /proc", allow_module_level=True)

HOURS = np.arange(60) / 60
# For every line it reads, this process leaks the kind of resource it is told to.
LEAK = """
import os, sys, threading
kept, end = [], threading.Event()
for line in sys.stdin:
    if "memory" in line:
        kept.append(b"x" * 300_000)
    if "descriptor" in line:
        kept.append(os.open("/dev/null", os.O_RDONLY))
    if "thread" in line:
        threading.Thread(target=end.wait, daemon=True).start()
    print(flush=True)
"""


@contextmanager
def leaking() -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-c", LEAK], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        yield process
    finally:
        process.communicate()


def evenings(process: subprocess.Popen[str], kept: str, count: int) -> tuple[Evening, ...]:
    """Return that many days, a minute each, on each of which the process leaks something."""
    assert process.stdin is not None
    assert process.stdout is not None
    days = []
    for day in range(count):
        process.stdin.write(f"{kept}\n")
        process.stdin.flush()
        process.stdout.readline()
        days.append(Evening(day / 60, {"leaking": process_use(process.pid)}, 1))
    return tuple(days)


def figures(days: tuple[Evening, ...]) -> SoakFigures:
    return SoakFigures(days, len(days) // 2, 0, {}, 0.0, 0)


@pytest.mark.parametrize("kept", ["memory", "descriptor", "thread", "nothing"])
def test_a_planted_leak_is_found_with_its_kind(kept: str) -> None:
    with leaking() as process:
        told = figures(evenings(process, kept, 24))
    (growth,) = told.growths
    assert growth.memory is not None
    if kept == "memory":
        assert growth.memory.per_hour == pytest.approx(60 * 300_000 / 2**20, rel=0.1)
    assert growth.descriptors_grow == (kept == "descriptor")
    assert growth.threads_grow == (kept == "thread")
    assert told.failed == (kept != "nothing")
    assert growth.held is (kept == "nothing")
    text = soak_markdown(told)
    assert ("**no**" in text) == (kept != "nothing")
    assert json.loads(json.dumps(told.as_dict(), allow_nan=False))["failed"] == told.failed


def test_a_slope_is_distinguished_from_noise() -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(0.0, 0.2, len(HOURS))
    flat, rising = slope(HOURS, 100 + noise), slope(HOURS, 100 + 3 * HOURS + noise)
    assert flat is not None
    assert rising is not None
    assert abs(flat.per_hour) < 3 * flat.std
    assert abs(rising.per_hour - 3) < 3 * rising.std
    assert flat.within(1.0) is True
    assert rising.within(1.0) is False
    assert rising.within(4.0) is True
    # Far beyond the limit, but too noisy to be certain.
    doubtful = slope(HOURS, 100 + 3 * HOURS + 50 * noise)
    assert doubtful is not None
    assert doubtful.within(1.0) is None
    assert slope(HOURS[:7], noise[:7]) is None


def test_correlated_noise_is_not_mistaken_for_a_trend() -> None:
    rng = np.random.default_rng(2)
    alarms = {"as it is": 0, "as independent": 0}
    for _ in range(200):
        # Each sample is correlated with the one before.
        wander = np.zeros(len(HOURS))
        for k in range(1, len(HOURS)):
            wander[k] = 0.8 * wander[k - 1] + rng.normal(0.0, 1.0)
        found = slope(HOURS, wander)
        assert found is not None
        line = np.polyfit(HOURS, wander, 1)
        left = wander - np.polyval(line, HOURS)
        plain = np.sqrt(left @ left / 58 / ((HOURS - HOURS.mean()) ** 2).sum())
        alarms["as it is"] += found.within(1.0) is False
        alarms["as independent"] += line[0] > max(1.0, 2.0 * plain)
    # 2.5 % are allowed; the correlation of so few samples is itself uncertain.
    assert alarms["as it is"] < 0.08 * 200 < alarms["as independent"]


def test_fluctuating_counts_are_not_growth() -> None:
    assert not grows([9, 7, 9, 9, 7, 9])
    assert not grows([7, 7, 7, 9, 9, 7])
    assert not grows([])
    assert grows([7, 8, 8, 9, 9, 10])
    gone = figures((Evening(0.0, {"web": ProcessUse(1.0, 1, 1)}, 4),))
    assert gone.failed is False
    assert "too short to tell" in soak_markdown(gone)
    more = tuple(Evening(k / 60, {"web": ProcessUse(1.0, 1, 1)}, 3 + k // 4) for k in range(12))
    assert figures(more).failed


def test_a_process_that_is_gone_is_reported() -> None:
    with leaking() as process:
        pass
    with pytest.raises(OSError, match=str(process.pid)):
        steady_use({"web": process.pid})


@pytest.mark.slow
@pytest.mark.patient
def test_a_busy_server_leaks_neither_threads_nor_descriptors() -> None:
    said: list[str] = []
    told = soak_figures(
        minutes=0.0,
        run_s=1.0,
        least_days=2,
        files=("speeds?format=csv",),
        pictures=4,
        say=said.append,
    )
    assert told.runs == 2 * len(told.evenings) == 2 * len(said) == 4
    assert told.refusals == {}
    assert told.tracebacks == 0
    first, last = told.evenings
    assert set(last.use) == {"web", "engine", "drive"}
    # Web, two engines, drive, and a reader for each camera.
    assert last.processes == first.processes == 6
    for name, use in last.use.items():
        assert use.descriptors <= first.use[name].descriptors + 1, (name, told.evenings)
        # Web's pools start a thread for each concurrent task, up to a limit, and drop some again.
        more = 8 if name == "web" else 1
        assert use.threads <= first.use[name].threads + more, (name, told.evenings)
        # One day needs far less than this; leaking a picture per frame would need far more.
        assert use.memory_mb < first.use[name].memory_mb + 25.0, (name, told.evenings)
    assert psutil.Process().children() == []

"""Limit of a process tree's processor time, by a control group of Linux."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

from app.client.server_process import MeasurementError

# As containers are limited: so much time in each period, then none until the next.
PERIOD_S = 0.1
_V1, _V2 = Path("/sys/fs/cgroup/cpu"), Path("/sys/fs/cgroup")
_NAME = "dynamic-observer-benchmark"


@contextmanager
def limited_processor(pid: int, share: float) -> Iterator[None]:
    """Give a process and its descendants this share of one core during the block.

    Raises:
        MeasurementError: control groups cannot be written here.
    """
    quota, period = round(share * PERIOD_S * 1e6), round(PERIOD_S * 1e6)
    if (_V1 / "cpu.cfs_quota_us").exists():
        root, limits = _V1, {"cpu.cfs_period_us": str(period), "cpu.cfs_quota_us": str(quota)}
        if (_V1 / "cpu.rt_runtime_us").exists():
            # Of each second. Without it no realtime process may join, as the drive process is one.
            limits["cpu.rt_runtime_us"] = str(round(share * 1e6))
    else:
        root, limits = _V2, {"cpu.max": f"{quota} {period}"}
    group = root / _NAME
    try:
        group.mkdir()
    except OSError as error:
        raise MeasurementError(
            f"cannot make {group}: {error.strerror}; run this as root on Linux"
        ) from None
    try:
        for name, value in limits.items():
            (group / name).write_text(value)
        _move(pid, group)
        yield
    except OSError as error:
        raise MeasurementError(f"cannot limit the processor: {error}") from None
    finally:
        _move(pid, root)
        group.rmdir()


def _move(pid: int, group: Path) -> None:
    process = psutil.Process(pid)
    for each in (process, *process.children(recursive=True)):
        (group / "cgroup.procs").write_text(str(each.pid))

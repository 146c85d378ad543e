"""Limit of a process tree's processor time, by a control group of Linux."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

from app.client.server_process import MeasurementError

# As for containers: a quota of time in each period, then none until the next.
PERIOD_S = 0.1
_V1, _V2 = Path("/sys/fs/cgroup/cpu"), Path("/sys/fs/cgroup")
_NAME = "dynamic-observer-benchmark"
_DISSOLVING_S = 5.0


@contextmanager
def limited_processor(pid: int, share: float) -> Iterator[None]:
    """Give a process and its descendants this share of one core during the block.

    Raises:
        MeasurementError: control groups cannot be written here.
    """
    root = _V1 if (_V1 / "cpu.cfs_quota_us").exists() else _V2
    group = root / _NAME
    try:
        group.mkdir()
    except OSError as error:
        raise MeasurementError(
            f"cannot make {group}: {error.strerror}; run this as root on Linux"
        ) from None
    try:
        _limit(pid, group, share)
        yield
    finally:
        _dissolve(group, root)


def _limit(pid: int, group: Path, share: float) -> None:
    quota, period = round(share * PERIOD_S * 1e6), round(PERIOD_S * 1e6)
    try:
        if group.parent == _V2:
            (group / "cpu.max").write_text(f"{quota} {period}")
        else:
            (group / "cpu.cfs_period_us").write_text(str(period))
            (group / "cpu.cfs_quota_us").write_text(str(quota))
        realtime = group / "cpu.rt_runtime_us"
        if realtime.exists():
            # Of each second. Without it, no realtime process such as the drive process may join.
            realtime.write_text(str(round(share * 1e6)))
        _move(pid, group)
    except OSError as error:
        raise MeasurementError(f"cannot limit the processor by {group}: {error}") from None


def _dissolve(group: Path, root: Path) -> None:
    """Move all processes of a group to the root, and remove the group.

    A process that is just ending keeps it busy for a moment, and one may just be starting another.
    """
    until = time.monotonic() + _DISSOLVING_S
    while True:
        for pid in (group / "cgroup.procs").read_text().split():
            with suppress(OSError):
                (root / "cgroup.procs").write_text(pid)
        try:
            group.rmdir()
        except OSError:
            if time.monotonic() > until:
                raise
            time.sleep(0.05)
        else:
            return


def _move(pid: int, group: Path) -> None:
    process = psutil.Process(pid)
    for each in (process, *process.children(recursive=True)):
        (group / "cgroup.procs").write_text(str(each.pid))

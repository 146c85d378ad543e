"""A process and its descendants get a share of one core, and all of it again afterwards."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from app.client.server_process import MeasurementError
from tools.benchmark import processor_share
from tools.benchmark.processor_share import limited_processor

BUSY = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'while True: pass'])"


def used_s(pid: int) -> float:
    process = psutil.Process(pid)
    times = [each.cpu_times() for each in (process, *process.children(recursive=True))]
    return sum(each.user + each.system for each in times)


def test_a_process_tree_gets_no_more_than_its_share() -> None:
    process = subprocess.Popen([sys.executable, "-c", BUSY])
    try:
        time.sleep(0.5)
        try:
            with limited_processor(process.pid, 0.2):
                before, began = used_s(process.pid), time.monotonic()
                time.sleep(2)
                share = (used_s(process.pid) - before) / (time.monotonic() - began)
        except MeasurementError as error:
            pytest.skip(str(error))
        assert 0 < share < 0.3
        with limited_processor(process.pid, 0.2):
            pass
    finally:
        for child in psutil.Process(process.pid).children():
            child.kill()
        process.kill()
        process.wait(10)


def test_a_group_that_cannot_be_made_is_reported(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("_V1", "_V2"):
        monkeypatch.setattr(processor_share, name, tmp_path / "missing")
    with (
        pytest.raises(MeasurementError, match=r"cannot make .*No such file.*run this as root"),
        limited_processor(1, 0.2),
    ):
        raise AssertionError

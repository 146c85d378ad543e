"""The doctor's findings about driving robots, on machines made of files."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from app.doctor.finding import Finding
from app.doctor.robots import examine_robots
from app.settings import Settings
from observer.machine import Machine
from observer.sources.cameras.device_files import User

from ...observer.sources.cameras.fake_machine import FakeMachine
from ...observer.sources.cameras.fake_v4l2 import FakeKernel

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="device files are Linux's")

STATUS = "Name:\tpython\nCapPrm:\t0000000000000000\nCapEff:\t{}\nCapBnd:\t000001ffffffffff\n"
LIMITS = """\
Limit                     Soft Limit           Hard Limit           Units
Max nice priority         {:<20} {:<20}
Max realtime priority     {:<20} 99
"""
NO_RIGHTS, SYS_NICE = "0000000000000000", "0000000000800000"
KEY = "0123456789abcdefSECRET"


class Bench:
    def __init__(self, folder: Path) -> None:
        self.files = FakeMachine(folder / "machine")
        self.kernel = FakeKernel({})
        self.data = folder / "data"
        self.data.mkdir()
        self.rights(NO_RIGHTS, 0, 0)

    def rights(self, effective: str, nice: int, realtime: int | str) -> None:
        folder = self.files.root / "proc" / "self"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "status").write_text(STATUS.format(effective))
        # The hard limit alone permits nothing: the soft limit has not been raised yet.
        (folder / "limits").write_text(LIMITS.format(nice, 40, realtime))

    def rig(self, **ports: str) -> None:
        lines = ", ".join(f'{role}: "{port}"' for role, port in ports.items())
        (self.data / "rig.yaml").write_text(f"ports: {{{lines}}}\n")

    def look(self) -> list[Finding]:
        machine = Machine(self.files.root, self.kernel, User("ada", frozenset({54321})), lambda: {})
        return list(examine_robots(Settings(data=self.data), machine))


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


@pytest.mark.parametrize(
    "permit",
    [
        lambda bench: bench.rights(SYS_NICE, 0, 0),
        lambda bench: bench.rights(NO_RIGHTS, 0, 1),
        lambda bench: bench.rights(NO_RIGHTS, 0, "unlimited"),
    ],
)
def test_real_time_priority_is_permitted_by_capability_or_limit(
    bench: Bench, permit: Callable[[Bench], None]
) -> None:
    permit(bench)
    (finding,) = bench.look()
    assert (finding.level, finding.text) == (
        "ok",
        "the drive loop is permitted to use real-time priority",
    )


@pytest.mark.parametrize(
    ("nice", "instead"), [(0, "late when the computer is busy"), (34, "late when"),
                          (35, "precedence over ordinary programs")],
)  # fmt: skip
def test_missing_real_time_priority_suggests_a_fix(bench: Bench, nice: int, instead: str) -> None:
    bench.rights(NO_RIGHTS, nice, 0)
    (finding,) = bench.look()
    # A warning for a machine that drives robots, only a hint for others.
    assert finding.level == "ok"
    assert instead in finding.text
    assert "'$USER - rtprio 1'" in finding.text
    bench.rig(observer="socket://10.0.0.7:8101")
    finding, _ = bench.look()
    assert finding.level == "warning"


def test_an_unknown_limit_is_no_problem(bench: Bench) -> None:
    (bench.files.root / "proc" / "self" / "limits").unlink()
    (finding,) = bench.look()
    assert finding.level == "ok"
    assert "unknown" in finding.text


def test_the_rigs_ports_are_examined(bench: Bench) -> None:
    by_id = bench.files.root / "dev" / "serial" / "by-id"
    by_id.mkdir(parents=True)
    (by_id / "usb-A").symlink_to("../../ttyUSB0")
    bench.rig(observer="/dev/serial/by-id/usb-A", obstacle=f"external:0.0.0.0:7700?key={KEY}")
    _, observer, obstacle = bench.look()
    assert observer.level == "warning"
    assert "the observer's port /dev/serial/by-id/usb-A does not exist" in observer.text
    assert (obstacle.level, "external:0.0.0.0:7700 " in obstacle.text) == ("ok", True)
    assert KEY not in obstacle.text
    port = bench.files.root / "dev" / "ttyUSB0"
    port.touch()
    _, observer, _ = bench.look()
    assert observer.level == "ok"
    assert observer.text == "the observer's port /dev/serial/by-id/usb-A is present"
    bench.files.groups(f"dialout:x:{port.stat().st_gid}:")
    bench.kernel.denied.add("ttyUSB0")
    _, observer, _ = bench.look()
    assert observer.level == "warning"
    assert "sudo usermod -aG dialout ada" in observer.text


def test_an_unreadable_rig_is_a_warning(bench: Bench) -> None:
    (bench.data / "rig.yaml").write_text("mount: [")
    rig, _ = bench.look()
    assert rig.level == "warning"
    assert "the rig is unknown" in rig.text


def test_the_examination_changes_no_files(bench: Bench) -> None:
    bench.rig(observer="/dev/ttyUSB0")
    before = sorted(each.relative_to(bench.data.parent) for each in bench.data.parent.rglob("*"))
    bench.look()
    after = sorted(each.relative_to(bench.data.parent) for each in bench.data.parent.rglob("*"))
    assert after == before

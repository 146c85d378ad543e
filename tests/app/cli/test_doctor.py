"""The doctor on machines made of files, and as a shell sees it."""

from __future__ import annotations

import json
import os
import socket
import sys
import threading
from collections.abc import Mapping
from http.server import BaseHTTPRequestHandler, HTTPServer
from io import StringIO
from pathlib import Path

import pytest
import typer
from rich.console import Console

from app.cli.doctor import doctor
from app.client.announced import AnnouncedServer, announced
from app.doctor.address import examine_address
from app.doctor.cameras import examine_cameras
from app.doctor.examination import Examination, examine
from app.doctor.finding import Finding
from app.doctor.serial_ports import examine_serial_ports
from app.doctor.software import _packages, _video_support, examine_software
from app.doctor.telling import tell
from app.settings import Settings
from observer.machine import Machine
from observer.sources.cameras.device_files import User
from observer.sources.cameras.spec import parse_devices

from ...observer.sources.cameras.fake_machine import FakeMachine
from ...observer.sources.cameras.fake_v4l2 import FakeCamera, FakeKernel, metadata_node, webcam
from .shell import in_a_process

STRANGER = User("ada", frozenset({54321}))
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="device files are Linux's")


def no_ports() -> Mapping[str, str]:
    return {}


class Bench:
    """A machine that is put together piece by piece, then examined."""

    def __init__(self, root: Path) -> None:
        self.files = FakeMachine(root)
        self.kernel = FakeKernel({})

    def camera(self, number: int, camera: FakeCamera, **place: object) -> None:
        self.files.camera(number, **place)  # type: ignore[arg-type]
        self.kernel.at[f"video{number}"] = camera

    @property
    def machine(self) -> Machine:
        return Machine(self.files.root, self.kernel, STRANGER, no_ports)

    def cameras(self) -> list[Finding]:
        return examine_cameras(self.machine)[0]


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path / "machine")


def levels(findings: list[Finding]) -> list[str]:
    return [finding.level for finding in findings]


def test_a_webcam_is_listed_with_its_stable_name_modes_and_ranges(bench: Bench) -> None:
    bench.camera(0, webcam())
    (finding,) = bench.cameras()
    assert (finding.level, finding.text) == ("ok", "HD Webcam (/dev/video0)")
    assert finding.details == (
        "persistent name for this port: /dev/v4l/by-path/pci-0000:00:14.0-usb-0:1:1.0-video-index0",
        "USB bus 1, port 1-1, 480 Mbit/s",
        "MJPG: 640x480 at 30/s, 1280x720 at 30/s",
        "YUYV: 640x480 at 30/s, 1280x720 at 10/s",
        "settable: gain 0 to 100, white balance 2800 to 6500 in steps of 10, exposure 3 to 2047",
    )


def test_many_sizes_are_shortened_to_the_usual_and_largest_ones(bench: Bench) -> None:
    sizes = [(160, 120), (320, 240), (640, 480), (800, 600), (1280, 720), (1920, 1080)]
    camera = webcam()
    camera.formats = {"MJPG": {size: [(1001, 30000)] for size in sizes}}
    bench.camera(0, camera)
    (finding,) = bench.cameras()
    assert (
        "MJPG: 640x480 at 30/s, 800x600 at 30/s, 1280x720 at 30/s, 1920x1080 at 30/s "
        "and 2 more sizes"
    ) in finding.details


def test_a_camera_without_permission_is_one_problem_for_both_its_nodes(
    bench: Bench,
) -> None:
    bench.camera(0, webcam(), name="Locked Cam")
    bench.camera(1, metadata_node(), index=1)
    bench.kernel.denied |= {"video0", "video1"}
    first, rest = bench.cameras()
    assert first.level == "problem"
    assert first.text.startswith("Locked Cam: only the group")
    assert "sudo usermod -aG video ada" in first.text
    assert (rest.level, rest.text) == (
        "ok",
        "other video nodes, which are not cameras: /dev/video1",
    )


def test_metadata_nodes_are_listed_as_non_cameras(bench: Bench) -> None:
    bench.camera(0, webcam())
    bench.camera(1, metadata_node(), index=1)
    findings = bench.cameras()
    assert levels(findings) == ["ok", "ok"]
    assert findings[1].text == "other video nodes, which are not cameras: /dev/video1 (metadata)"


def test_a_camera_in_use_is_a_warning(bench: Bench) -> None:
    bench.camera(0, webcam())
    bench.files.process(77, "cheese", "/dev/video0")
    (finding,) = bench.cameras()
    assert finding.level == "warning"
    assert "cheese (process 77)" in finding.text


def test_two_cameras_on_one_bus_are_a_warning(bench: Bench) -> None:
    bench.camera(0, webcam(), port="1-1")
    bench.camera(2, webcam(), port="1-2")
    findings = bench.cameras()
    assert levels(findings) == ["ok", "ok", "warning", "ok"]
    assert "36.9 MB/s in total" in findings[2].text
    names = [f"/dev/v4l/by-path/pci-0000:00:14.0-usb-0:{n}:1.0-video-index0" for n in (1, 2)]
    assert f"serve 'camera:{names[0]},{names[1]}?format=MJPG'" in findings[3].text


def test_the_suggested_command_for_two_cameras_is_parsable(bench: Bench) -> None:
    bench.camera(0, webcam(), port="1-1")
    bench.camera(2, webcam(), port="2-7", bus=2)
    command = bench.cameras()[-1].text.partition("dynamic-observer serve ")[2]
    spec = parse_devices(command.strip("'").removeprefix("camera:"))
    assert [target.address for target in spec.targets] == [
        "/dev/v4l/by-path/pci-0000:00:14.0-usb-0:1:1.0-video-index0",
        "/dev/v4l/by-path/pci-0000:00:14.0-usb-0:7:1.0-video-index0",
    ]


def test_a_missing_camera_is_ok_and_hints_at_container_devices(bench: Bench) -> None:
    (finding,) = bench.cameras()
    assert finding.level == "ok"
    assert "--device /dev/video0" in finding.text


def test_a_camera_without_its_driver_is_a_warning(bench: Bench) -> None:
    interface = bench.files.root / "sys/bus/usb/devices/1-1:1.0"
    interface.mkdir(parents=True)
    (interface / "bInterfaceClass").write_text("0e\n")
    (finding,) = bench.cameras()
    assert finding.level == "warning"
    assert "modprobe uvcvideo" in finding.text


def test_serial_ports_are_listed_with_names_and_permissions(bench: Bench) -> None:
    port = bench.files.root / "dev" / "ttyUSB0"
    port.touch()
    (bench.files.root / "dev" / "ttyS0").touch()
    by_id = bench.files.root / "dev" / "serial" / "by-id"
    by_id.mkdir(parents=True)
    (by_id / "usb-Prolific_2303-if00-port0").symlink_to("../../ttyUSB0")
    bench.files.groups(f"dialout:x:{port.stat().st_gid}:")
    machine = Machine(
        bench.files.root, bench.kernel, STRANGER, lambda: {"/dev/ttyUSB0": "USB-Serial Controller"}
    )
    (finding,), (listed,) = examine_serial_ports(machine)
    assert (finding.level, finding.text) == ("ok", "/dev/ttyUSB0 (USB-Serial Controller)")
    assert listed.by_id == "/dev/serial/by-id/usb-Prolific_2303-if00-port0"
    bench.kernel.denied.add("ttyUSB0")
    (finding,), (listed,) = examine_serial_ports(machine)
    assert finding.level == "warning"
    assert "sudo usermod -aG dialout ada" in finding.text
    assert listed.trouble == finding.text
    assert not listed.usable


def test_a_missing_serial_port_is_ok(bench: Bench) -> None:
    (finding,), ports = examine_serial_ports(bench.machine)
    assert (finding.level, ports) == ("ok", ())
    assert "--device /dev/ttyUSB0" in finding.text


def test_installed_software_has_no_problems() -> None:
    findings = list(examine_software())
    assert "problem" not in levels(findings)
    told = "\n".join(finding.text for finding in findings)
    assert "numpy " in told
    assert "(FFMPEG)" in told


def test_missing_packages_are_distinguished_from_missing_extras() -> None:
    findings = list(_packages(["numpy>=1.26", "no-such-package>=1", 'absent-too; extra == "dev"']))
    assert [f.text for f in findings if f.level == "problem"] == [
        "packages are missing: no-such-package; make setup installs them"
    ]


def test_opencv_without_video_support_is_a_warning() -> None:
    findings = list(_video_support({"V4L2", "CV_IMAGES"}))
    assert levels(findings) == ["ok", "warning"]
    assert "network cameras (no FFMPEG)" in findings[1].text


def test_a_port_in_use_is_a_problem(free_port: int) -> None:
    settings = Settings(port=free_port)
    assert examine_address(settings).level == "ok"
    with socket.create_server(("127.0.0.1", free_port)):
        finding = examine_address(settings)
    assert finding.level == "problem"
    # The listener is this process.
    assert f"port {free_port} of 127.0.0.1 is in use by " in finding.text
    assert f"process {os.getpid()}" in finding.text
    assert examine_address(settings).level == "ok"


def test_a_free_port_lists_the_addresses_of_a_server_there(free_port: int) -> None:
    here, others = examine_address(Settings(port=free_port)).details
    assert here == f"from this computer at http://127.0.0.1:{free_port}"
    assert "--host 0.0.0.0" in others
    everywhere = Settings(host="0.0.0.0", port=free_port, allowed_hosts=("lab.example",))
    here, others = examine_address(everywhere).details
    assert here == f"from this computer at http://localhost:{free_port}"
    assert f"http://lab.example:{free_port}" in others


def test_our_own_server_is_recognised_by_its_response(free_port: int, tmp_path: Path) -> None:
    class Alive(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b'{"status": "ok"}')

        def log_message(self, *_: object) -> None:
            pass

    settings = Settings(port=free_port, data=tmp_path)
    told = AnnouncedServer(
        host="127.0.0.1", port=free_port, tls=False, allowed_hosts=(), token="t",
        read_only_token="r",
    )  # fmt: skip
    with HTTPServer(("127.0.0.1", free_port), Alive) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            alone = examine_address(settings)
            with announced(tmp_path, told):
                known = examine_address(settings)
        finally:
            server.shutdown()
            thread.join()
    assert "is in use by a running Dynamic Observer" in alone.text
    assert alone.details == ()
    assert known.details[0] == f"from this computer at http://127.0.0.1:{free_port}"
    assert "dynamic-observer link" in known.details[-1]


def test_an_address_of_another_machine_is_a_problem() -> None:
    finding = examine_address(Settings(host="192.0.2.1"))
    assert finding.level == "problem"
    assert "--host" in finding.text


def told(examination: Examination, *, terminal: bool) -> str:
    file = StringIO()
    tell(examination, Console(file=file, force_terminal=terminal, width=60))
    return file.getvalue()


def test_without_a_terminal_output_is_plain_ascii(bench: Bench, tmp_path: Path) -> None:
    bench.camera(0, webcam())
    examination = examine(Settings(data=tmp_path, port=0), bench.machine)
    text = told(examination, terminal=False)
    assert text.isascii()
    assert "  ok       HD Webcam (/dev/video0)\n             persistent name" in text
    assert text.endswith("Nothing prevents the start.\n")
    assert not examination.hindered


def test_a_terminal_gets_marks_and_whole_sentences(bench: Bench, tmp_path: Path) -> None:
    bench.camera(0, webcam())
    bench.kernel.denied.add("video0")
    examination = examine(Settings(data=tmp_path, port=0), bench.machine)
    text = told(examination, terminal=True)
    assert "✗" in text
    assert "sign out and in again: sudo usermod -aG video ada\n" in text
    assert "1 problem prevents the start." in text
    assert examination.hindered


def test_invalid_settings_are_a_finding(bench: Bench) -> None:
    examination = examine("the environment variable X names no setting", bench.machine)
    assert examination.hindered
    assert examination.findings[-1].section == "Settings"


def test_json_contains_the_devices(bench: Bench, tmp_path: Path) -> None:
    bench.camera(0, webcam())
    examination = examine(Settings(data=tmp_path, port=0), bench.machine)
    read = json.loads(json.dumps(examination.as_json(), allow_nan=False))
    assert read["hindered"] is False
    (camera,) = read["cameras"]
    assert camera["modes"][0]["pixel_format"] == "MJPG"
    assert camera["usb"]["speed_mbit"] == 480.0


def test_a_problem_gives_exit_code_1_and_the_reason(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = in_a_process("doctor", "--data", str(tmp_path / "file" / "data"), "--json")
    assert done.code == 1
    read = json.loads(done.out)
    assert read["hindered"] is True
    data = [finding for finding in read["findings"] if finding["section"] == "Data"]
    assert data[0]["level"] == "problem"
    assert "is a file, not a folder" in data[0]["text"]


def test_exit_code_is_0_without_problems(
    tmp_path: Path,
    free_port: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("DYNAMIC_OBSERVER_PORT", str(free_port))
    with pytest.raises(typer.Exit) as ended:
        doctor(tmp_path)
    # Cameras of this machine without permissions are rightly a problem.
    text = capsys.readouterr().out
    assert ended.value.exit_code == int("PROBLEM" in text)
    assert f"runs and settings are kept in {tmp_path}" in text


def test_a_mistyped_setting_is_reported_and_the_rest_still_examined(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("DYNAMIC_OBSERVER_PROT", "9000")
    with pytest.raises(typer.Exit) as ended:
        doctor(None)
    assert ended.value.exit_code == 1
    text = capsys.readouterr().out
    assert "DYNAMIC_OBSERVER_PROT is not a setting" in text
    assert "Cameras" in text

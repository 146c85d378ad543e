"""A lab to soak a server in: two network cameras, and an emulated robot behind a TCP port.

With a simulated source the engine holds hundreds of megabytes of textures, which hide any slow
growth; with cameras it holds some tens.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx

from app.client.server_process import MeasurementError, RunningServer, running_server
from observer.calibration.formats.opencv_file import calibration_text
from observer.rig.rig import Role
from observer.simulation.robots.emulated import EmulatedRobot
from observer.simulation.robots.serving import serve_tcp
from observer.simulation.scenarios import load_scenario
from observer.simulation.world import World
from tools.benchmark.camera_streams import camera_streams
from tools.benchmark.live_capture import encoded_pairs, write_pairs

_SCENARIO, _RATE = "lab", 15.0
_MODEL = "p3dx-sh"
ROLE: Role = "obstacle"
_TIMEOUT_S = 20.0


@dataclass(frozen=True)
class Lab:
    """Server in its lab.

    Attributes:
        source: the two cameras. calibration: the server's id of theirs.
    """

    server: RunningServer
    source: str
    calibration: str

    def play(self, source: str) -> None:
        """Switch to a source and wait for its frames.

        Raises:
            MeasurementError: it is refused, or brings none.
        """
        before = self.server.request("GET", "/api/status")["frames_observed"]
        choice = {"source": source}
        if source == self.source:
            choice["calibration"] = self.calibration
        self.server.request("PUT", "/api/source", choice)
        until = time.monotonic() + _TIMEOUT_S
        while self.server.request("GET", "/api/status")["frames_observed"] < before + 10:
            if time.monotonic() > until:
                raise MeasurementError(f"{source} brought no frames")
            time.sleep(0.1)

    def download(self, path: str) -> int:
        """Fetch a file and discard it; return its size in bytes.

        Raises:
            MeasurementError: it was refused.
        """
        with _client(self.server) as http, http.stream("GET", path) as answer:
            size = sum(len(chunk) for chunk in answer.iter_bytes())
        if not answer.is_success:
            raise MeasurementError(f"GET {path} was answered {answer.status_code}")
        return size


@contextmanager
def running_lab(pictures: int) -> Iterator[Lab]:
    """Run cameras, a robot and a server that observes and drives them.

    Args:
        pictures: number of different pairs that the cameras show, to and fro.

    Raises:
        MeasurementError: the server did not start, or did not accept the cameras.
    """
    world = World(load_scenario(_SCENARIO))
    robot = serve_tcp(EmulatedRobot(_MODEL, now=time.monotonic(), seed=0))
    with robot, tempfile.TemporaryDirectory(prefix="dynamic-observer-benchmark-") as folder:
        write_pairs(Path(folder), encoded_pairs(world, pictures))
        with camera_streams(Path(folder), _RATE) as addresses:
            source = ",".join(addresses)
            with running_server(source) as server:
                calibration = _upload(server, calibration_text(world.true_calibration))
                lab = Lab(server, source, calibration)
                lab.play(source)
                choice = {"port": robot.port, "model": _MODEL}
                server.request("PUT", f"/api/robots/{ROLE}/port", choice)
                yield lab


def _upload(server: RunningServer, text: str) -> str:
    files = {"file": ("calibration.yaml", text.encode())}
    with _client(server) as http:
        answer = http.post("/api/calibrations", files=files)
    if not answer.is_success:
        raise MeasurementError(f"the calibration was answered {answer.status_code}: {answer.text}")
    return str(answer.json()["id"])


def _client(server: RunningServer) -> httpx.Client:
    return httpx.Client(
        base_url=f"http://127.0.0.1:{server.port}",
        headers={"Authorization": f"Bearer {server.token}"},
        timeout=120.0,
        trust_env=False,
    )

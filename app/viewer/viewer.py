"""Viewer for the server: a port on loopback, and a thread that keeps the scene fresh.

It may fail (a missing wheel, no free port) without affecting anything else; a ``NullViewer`` then
gives the reason.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import structlog

from app.contract.events import LocalMapEvent, ObservationEvent, StateEvent
from app.contract.robots import RobotsNow
from app.contract.views import CLOUD_NAME
from app.server import Server
from app.viewer.map_tiles import map_tiles
from app.viewer.picture import make_picture, read_cloud
from observer.guard.parameters import GuardParameters

if TYPE_CHECKING:
    from app.viewer.scene import Scene

log = structlog.get_logger(__name__)

# Fewer images than clouds: the picture in the frustum is small.
_IMAGE_INTERVAL_S = 0.2
_IDLE_S = 0.1
_STOP_TIMEOUT_S = 5.0


class NullViewer:
    """Placeholder for a missing ``ViserViewer``, with the reason."""

    port: int | None = None
    headers: Mapping[str, str] = MappingProxyType({})

    def __init__(self, trouble: str) -> None:
        self.trouble: str | None = trouble

    def page(self) -> bytes:
        return b""

    @contextmanager
    def connected(self) -> Iterator[None]:
        yield

    def stop(self) -> None:
        """Do nothing: there is nothing to end."""


@dataclass(frozen=True)
class _Moment:
    """All of the event loop's facts that the scene shows, at one instant.

    Attributes:
        observation, state, generation, local_map: of the source. driving: state of the robots.
        limits: the guard's parameters.
    """

    observation: ObservationEvent | None
    state: StateEvent
    generation: int
    local_map: LocalMapEvent | None
    driving: RobotsNow
    limits: GuardParameters

    @classmethod
    def of(cls, server: Server) -> _Moment:
        """Return the present facts (in the event loop, which changes them)."""
        source = server.source
        return cls(
            observation=source.latest,
            state=source.state,
            generation=source.generation,
            local_map=source.local_map,
            driving=server.driving.facts(),
            limits=server.parameters.current.values.guard,
        )


class ViserViewer:
    """Viewer that shows our scene with viser, updated at a fixed rate while somebody looks.

    Args:
        points: maximum number of points of the cloud.
        rate_hz: maximum updates per second.

    Attributes:
        port: of viser on 127.0.0.1; None if there is no viewer. headers: required by its
            WebSocket.
        trouble: the reason why there is none, one sentence.
    """

    trouble: str | None = None

    def __init__(self, server: Server, *, points: int, rate_hz: float) -> None:
        from app.viewer.private_viser import PrivateViser
        from app.viewer.scene import Scene

        self._server = server
        self._interval = 1.0 / rate_hz
        self._viser = PrivateViser()
        try:
            self._scene: Scene = Scene(self._viser.server, points)
        except BaseException:
            self._viser.stop()
            raise
        self.port: int | None = self._viser.port
        self.headers: Mapping[str, str] = self._viser.headers
        self._lookers = 0
        self._looking = ExitStack()
        # Set in the event loop, read in the thread; None while nobody looks.
        self._moment: _Moment | None = None
        self._stopping = threading.Event()
        self._cloud_sequence = 0
        self._image_sequence = 0
        self._image_due = 0.0
        self._local_map: LocalMapEvent | None = None
        self._thread = threading.Thread(target=self._run, name="viewer", daemon=True)
        self._thread.start()

    def page(self) -> bytes:
        """Return the client's page."""
        import viser

        client = Path(viser.__file__).parent / "client" / "build" / "index.html"
        return client.read_bytes()

    @contextmanager
    def connected(self) -> Iterator[None]:
        """Count a client that looks at the scene while the block runs (in the event loop)."""
        self._lookers += 1
        try:
            if self._lookers == 1:
                self._looking.callback(self._server.watching.enter("plain", CLOUD_NAME))
                self._looking.callback(self._server.followers.follow(self))
                self._look()
            yield
        finally:
            self._lookers -= 1
            if self._lookers == 0:
                self._looking.close()
                self._moment = None

    def stop(self) -> None:
        """End threads and sockets; safe to call twice."""
        if self._stopping.is_set():
            return
        self._stopping.set()
        self._thread.join(_STOP_TIMEOUT_S)
        self._viser.stop()

    # --- follower of the server -------------------------------------------------------------

    def observed(self, event: ObservationEvent) -> None:
        del event
        self._look()

    def status_changed(self) -> None:
        self._look()

    def robots_changed(self) -> None:
        self._look()

    def _look(self) -> None:
        self._moment = _Moment.of(self._server)

    # --- thread -----------------------------------------------------------------------------

    def _run(self) -> None:
        due = time.monotonic()
        while not self._stopping.wait(max(0.0, due - time.monotonic())):
            moment = self._moment
            due = (
                max(due + self._interval, time.monotonic())
                if moment is not None
                else (time.monotonic() + _IDLE_S)
            )
            if moment is not None:
                try:
                    self._update(moment)
                except Exception:
                    # A faulty picture must not end the viewer, nor a faulty viewer the server.
                    log.exception("viewer_update_failed")
                    self._stopping.wait(1.0)

    def _update(self, moment: _Moment) -> None:
        server = self._server
        now = server.clock()
        with self._scene.together():
            picture = make_picture(
                *(moment.observation, moment.state, moment.generation, now, moment.driving),
                limits=moment.limits,
            )
            self._scene.show(picture, now)
            local_map = None if picture.stale else moment.local_map
            if local_map is not self._local_map:
                self._local_map = local_map
                self._scene.show_map(map_tiles(local_map))
            cloud = server.engine.cloud.read(self._cloud_sequence)
            if cloud is not None:
                self._cloud_sequence = cloud.sequence
                self._scene.show_cloud(read_cloud(cloud))
            if now >= self._image_due:
                self._image_due = now + _IMAGE_INTERVAL_S
                image = server.engine.views["plain"].read(self._image_sequence)
                if image is not None:
                    self._image_sequence = image.sequence
                    self._scene.show_image(image.payload)


Viewer = ViserViewer | NullViewer


def start_viewer(server: Server, *, points: int, rate_hz: float) -> Viewer:
    """Start the viewer, or return a null one with the reason. Takes a second; use a thread."""
    try:
        return ViserViewer(server, points=points, rate_hz=rate_hz)
    except Exception as error:
        log.exception("viewer_not_started")
        return NullViewer(f"the 3D viewer could not be started: {error}")

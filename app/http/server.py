"""The web application, assembled explicitly from its parts."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI, WebSocket

from app.contract.views import VIEW_NAMES
from app.http import metrics
from app.http.api import (
    boards,
    calibrating,
    calibrations,
    comparing,
    devices,
    goals,
    guard_checks,
    history,
    journal,
    links,
    live_truth,
    parameters,
    pixels,
    programmes,
    recordings,
    rig,
    robots,
    run_files,
    run_frames,
    run_truths,
    runs,
    scene,
    sessions,
    sources,
    status,
    steps,
    truths,
    views,
)
from app.http.api.common import TheServer
from app.http.api.refusals import BODY_RESPONSES, GATE_RESPONSES, refusal_schemas
from app.http.compressed import CompressedAnswers
from app.http.errors import install_error_handlers
from app.http.gate.admission import COOKIE_NAME, Admission
from app.http.gate.origins import names_of
from app.http.gate.security import Gate, Policy
from app.http.gate.session_file import SESSION_FILE, SessionFile
from app.http.gate.sessions import Sessions
from app.http.gate.token import TokenGuard
from app.http.pages import add_pages, help_folder, sign_in_page, static_folder
from app.http.sharing import Sharing
from app.http.sockets import viewer_proxy
from app.http.sockets.drive import DriveSocket
from app.http.sockets.live import LiveHub
from app.http.sockets.view_feed import ViewFeed
from app.http.sockets.viewer_proxy import ViewerDoor
from app.runtime.endless import keep_running
from app.server import Engine, Server
from app.server.contracts import Drive
from app.server.journal import Journal
from app.settings import CHECK_FOLDER, PROGRAMME_FOLDER, RIG_FILE, Settings
from app.storage import Storage
from app.viewer import Viewer, start_viewer
from observer.version import library_version

_DESCRIPTION = """
Detects moving obstacles from a moving robot with a stereo camera.

Open the printed link, which signs a browser in and gives it a cookie for its session, or send
`Authorization: Bearer TOKEN`. A WebSocket whose session ends is closed with code 4401.

A read-only link (`GET /api/links`) is for watching: with its token or session everything can be
read, the robots can be stopped, and any other change is refused with 403. `DELETE
/api/links/read-only/{id}` revokes one.

Besides these routes there are four WebSockets:

* `/api/live`: telemetry. The server sends `status`, `robots`, `observation`, `log` and `heartbeat`;
  the client answers each observation it has painted with `{"type": "painted", "sequence": NUMBER}`
  and has at most two of them outstanding.
* `/api/views/{name}`: a live view. Binary: 8 bytes sequence and 8 bytes age in ms (float64), both
  big-endian, then JPEG. The client answers each one with the text `ack`.
* `/api/drive`: driving by hand, JSON; `?name=` gives the operator's name. One socket is one
  operator, whose control ends with it. The client sends `{"type": "take", "role", "takeover"}`,
  `release` with its role, ten times a second `{"type": "drive", "role", "sequence", "time",
  "speed_mps", "turn_rate_radps"}` or, without velocities, `present`, and `{"type": "stop"}`. `time`
  is `performance.now()`, `sequence` must increase. The server answers with `lease`, `sent` or
  `refused`, reports on the `link`, and sends `ping` with an `id`, which the client answers at once
  with `{"type": "pong", "id", "time"}`. Commands older than 250 ms on arrival are not executed.
* `/viewer`: the 3D scene of viser's client.
"""
_TAGS = [
    {"name": "status", "description": "Overall state."},
    {"name": "source", "description": "Where frames come from, and playback."},
    {"name": "runs", "description": "Recorded observations."},
    {"name": "parameters", "description": "Parameters of the method, and presets."},
    {"name": "calibrations", "description": "Calibrations of stereo cameras."},
    {"name": "calibrating", "description": "Calibration with a printed board."},
    {"name": "rig", "description": "Camera mount on the robot."},
    {"name": "truth", "description": "Motion capture, live."},
    {
        "name": "robots",
        "description": "Driving. The stop is a software stop, not a substitute for an emergency "
        "stop.",
    },
    {"name": "programmes", "description": "Timed velocities for robots."},
    {"name": "views", "description": "Live images."},
    {"name": "steps", "description": "The paper's method on one frozen pair of frames."},
    {"name": "sessions", "description": "Signing out, and links for others."},
    {"name": "pixels", "description": "Why a pixel counts as moving or static."},
]

ViewerStarter = Callable[[Server], Viewer]


def create_app(
    settings: Settings,
    token: str,
    *,
    engine: Engine | None = None,
    drive: Drive | None = None,
    storage: Storage | None = None,
    viewer: ViewerStarter | None = None,
) -> FastAPI:
    """Create the application; its lifespan starts and ends everything it owns.

    Args:
        token: required to use the server.
        engine, drive, storage, viewer: replace the real ones. With another engine and no drive,
            nothing can be driven.
    """
    if engine is None:
        engine, drive = _real_processes(drive)
    server = _server(settings, engine, drive, storage)
    admission = _admission(settings, token)
    log = Journal(server)
    live = LiveHub(server, log)
    door = ViewerDoor()
    owned = _Owned(server, admission.file, log, live, door, viewer or _real_viewer(settings))
    app = FastAPI(
        title="Dynamic Observer",
        version=library_version(),
        description=_DESCRIPTION,
        openapi_tags=_TAGS,
        openapi_url="/openapi.json",
        docs_url=None,
        redoc_url=None,
        lifespan=owned.lifespan,
        redirect_slashes=False,
        separate_input_output_schemas=False,
    )
    app.state.server = server
    app.state.viewer = door
    app.state.feeds = {name: ViewFeed(server, name) for name in VIEW_NAMES}
    app.state.live = live
    app.state.journal = log
    app.state.admission = admission
    app.state.sharing = Sharing(settings, token)
    install_error_handlers(app)
    _add_rest(app, live)
    app.include_router(viewer_proxy.router)
    app.include_router(metrics.router)
    folder = static_folder()
    policy = _policy(settings, admission, folder)
    add_pages(app, server, policy, folder, help_folder())
    _complete_description(app)
    app.add_middleware(CompressedAnswers)
    app.add_middleware(Gate, policy=policy)
    return app


@dataclass(frozen=True)
class _Owned:
    """Everything that starts and ends with the application."""

    server: Server
    sessions: SessionFile
    log: Journal
    live: LiveHub
    door: ViewerDoor
    viewer: ViewerStarter

    @asynccontextmanager
    async def lifespan(self, _: FastAPI) -> AsyncIterator[None]:
        """Run it during the context; it ends in reverse order."""
        async with AsyncExitStack() as stack:
            stack.push_async_callback(self.server.stop)
            stack.push_async_callback(_stop_viewer, self.door)
            await self.server.start()
            stack.callback(self.log.follow())
            _keep_going(stack, self.live.run, "live hub")
            self.sessions.load()
            # Saved at once, so that a shared link survives a crash.
            await self.sessions.save()
            stack.push_async_callback(self.sessions.save)
            _keep_going(stack, self.sessions.keep, "session keeper")
            # The page is served at once; the viewer takes a second and may fail.
            starting = asyncio.create_task(_start_viewer(self.door, self.viewer, self.server))
            stack.push_async_callback(_finish, starting)
            yield


def _keep_going(stack: AsyncExitStack, work: Callable[[], Awaitable[None]], name: str) -> None:
    """Run endless work until the stack is closed."""
    task = asyncio.create_task(keep_running(work, name), name=name)
    stack.push_async_callback(_cancel, task)


def _server(
    settings: Settings, engine: Engine, drive: Drive | None, storage: Storage | None
) -> Server:
    return Server(
        engine,
        storage or Storage(settings.database_location, folder=settings.data),
        source=settings.source,
        rig_file=settings.data / RIG_FILE,
        programme_folder=settings.data / PROGRAMME_FOLDER,
        check_folder=settings.data / CHECK_FOLDER,
        drive=drive,
        clips_at_guard_stops=settings.clips_at_guard_stops,
        live_truth=settings.truth,
    )


def _policy(settings: Settings, admission: Admission, static: Path) -> Policy:
    return Policy(
        names=names_of(settings.host, settings.allowed_hosts, tls=settings.tls),
        admission=admission,
        body_max_bytes=settings.body_max_bytes,
        uploads={
            "/api/calibrations": settings.calibration_max_bytes,
            "/api/calibrating/images": settings.images_max_bytes,
            "/api/truth": settings.truth_max_bytes,
        },
        sign_in_page=sign_in_page(static),
    )


def _real_viewer(settings: Settings) -> ViewerStarter:
    def start(server: Server) -> Viewer:
        return start_viewer(server, points=settings.viewer_points, rate_hz=settings.viewer_rate_hz)

    return start


def _admission(settings: Settings, token: str) -> Admission:
    sessions = Sessions(
        token,
        time.monotonic,
        unused_s=settings.session_unused_hours * 3600,
        lifetime_s=settings.session_days * 86_400,
    )
    # Without a token file the next start has a new token, which ends these sessions.
    path = None if settings.token_file is None else settings.data / SESSION_FILE
    file = SessionFile(path, sessions, time.time)
    guard = TokenGuard(token, time.monotonic, sessions.links)
    return Admission(guard, sessions, file, settings.tls)


def _real_processes(drive: Drive | None) -> tuple[Engine, Drive]:
    from app.drive.supervisor import DriveSupervisor
    from app.engine.supervisor import EngineSupervisor

    engine = EngineSupervisor()
    return engine, drive or DriveSupervisor(engine.shared_slots)


def _add_rest(app: FastAPI, live: LiveHub) -> None:
    api = APIRouter(prefix="/api", responses=GATE_RESPONSES)
    for part in (
        status,
        journal,
        sources,
        devices,
        runs,
        run_files,
        run_frames,
        run_truths,
        comparing,
        truths,
        history,
        parameters,
        calibrations,
        calibrating,
        boards,
        rig,
        live_truth,
        robots,
        guard_checks,
        goals,
        programmes,
        recordings,
        views,
        scene,
        sessions,
        links,
        pixels,
        steps,
    ):
        api.include_router(part.router)

    @api.websocket("/drive")
    async def drive_socket(socket: WebSocket, server: TheServer, name: str | None = None) -> None:
        await socket.accept()
        await DriveSocket(socket, server, name).serve()

    @api.websocket("/live")
    async def live_socket(socket: WebSocket) -> None:
        await socket.accept()
        await live.serve(socket)

    app.include_router(api)


def _complete_description(app: FastAPI) -> None:
    """Add sign-in and refusals to the API description."""
    describe = app.openapi

    def described() -> dict[str, Any]:
        schema = describe()
        components = schema.setdefault("components", {})
        components.setdefault("schemas", {}).update(refusal_schemas())
        components["securitySchemes"] = {
            "bearer": {"type": "http", "scheme": "bearer"},
            "cookie": {"type": "apiKey", "in": "cookie", "name": COOKIE_NAME},
        }
        schema["security"] = [{"bearer": []}, {"cookie": []}]
        for operations in schema["paths"].values():
            for method, operation in operations.items():
                if method != "get":
                    operation["responses"].update(BODY_RESPONSES)
        return schema

    app.openapi = described  # type: ignore[method-assign]


async def _start_viewer(door: ViewerDoor, start: ViewerStarter, server: Server) -> None:
    await asyncio.to_thread(lambda: door.open(start(server)))


async def _stop_viewer(door: ViewerDoor) -> None:
    await asyncio.to_thread(door.viewer.stop)


async def _finish(task: asyncio.Task[None]) -> None:
    await asyncio.gather(task, return_exceptions=True)


async def _cancel(task: asyncio.Task[None]) -> None:
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)

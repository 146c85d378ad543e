"""Survey by several looks at the floor, to estimate the camera's height and tilt."""

from __future__ import annotations

import asyncio

from app.contract.commands import LookAtFloor
from app.contract.rig import FloorEstimate, RigNumber
from app.contract.values import filled
from app.server.asking import ask
from app.server.contracts import Engine
from app.server.errors import Conflict
from observer.camera import StereoCamera
from observer.rig.estimates import Refused
from observer.rig.ground_estimate import estimate_ground

_LOOKS = 6
_PAUSE_S = 0.25


async def survey_floor(engine: Engine, camera: StereoCamera | None) -> FloorEstimate:
    """Look at the floor a few times and estimate the camera's height and tilt above it.

    Args:
        camera: the rectified camera from the engine's state.

    Raises:
        Conflict: no source is open, or the floor cannot be recognised; one sentence says what would
            help.
        NotAvailable: there is no engine at the moment.
    """
    if camera is None:
        raise Conflict("no source is open that could see the floor; open one first")
    views, seen = [], set()
    for look in range(_LOOKS):
        if look:
            await asyncio.sleep(_PAUSE_S)
        reply = await ask(engine, LookAtFloor())
        # While paused the frame never changes, so one look gives all the information.
        if reply.frame not in seen:
            seen.add(reply.frame)
            views.append(reply.points)
    estimate = await asyncio.to_thread(estimate_ground, views, camera)
    if isinstance(estimate, Refused):
        raise Conflict(estimate.sentence)
    return filled(
        FloorEstimate,
        estimate,
        height_m=filled(RigNumber, estimate.height_m),
        tilt_deg=filled(RigNumber, estimate.tilt_rad.degrees),
        roll_deg=filled(RigNumber, estimate.roll_rad.degrees),
    )

"""Poses and boxes of the scene's objects."""

from __future__ import annotations

import numpy as np

from observer.coppeliasim.connection import Connection, CoppeliaSimError
from observer.geometry import Float64Array, Pose

# A half turn about z: a sensor's y is up and its x left.
R_SENSOR_CAMERA = np.diag([-1.0, -1.0, 1.0])


def pose_of(connection: Connection, handle: int) -> Pose:
    """Return an object's pose in the room.

    Raises:
        CoppeliaSimError: the answer is not ``[x, y, z, qx, qy, qz, qw]``.
    """
    given = connection.call("getObjectPose", handle)
    x = connection.finite(given, 7)
    try:
        return Pose.from_quaternion((x[6], x[3], x[4], x[5]), x[:3])
    except ValueError:
        raise CoppeliaSimError(
            f"CoppeliaSim at {connection.address} returned an invalid pose: {given!r}"
        ) from None


def pose_numbers(pose: Pose) -> list[float]:
    """Return a pose in the simulator's form, ``[x, y, z, qx, qy, qz, qw]``."""
    w, x, y, z = pose.quaternion_wxyz.tolist()
    return [*pose.translation.tolist(), x, y, z, w]


def bounds(
    connection: Connection, handle: int, *, model: bool
) -> tuple[Float64Array, Float64Array]:
    """Return the lower and upper corner (3,) of an object's box in its own frame, metres.

    Args:
        model: the box encloses the whole model whose base the object is.
    """
    prefix = "modelbbox" if model else "objbbox"

    def corner(end: str) -> Float64Array:
        parameters = [connection.constant(f"objfloatparam_{prefix}_{end}_{axis}") for axis in "xyz"]
        return np.array([connection.number("getObjectFloatParam", handle, p) for p in parameters])

    return corner("min"), corner("max")

"""Poses as CoppeliaSim gives them, and the frames that are made of them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from observer.coppeliasim.connection import Connection, CoppeliaSimError
from observer.geometry import Float64Array, Pose

# Turned by 180 degrees about z, either way: a sensor's y is up and its x left.
R_SENSOR_CAMERA = np.diag([-1.0, -1.0, 1.0])


def pose_of(connection: Connection, handle: int, relative_to: int | None = None) -> Pose:
    """An object's pose, in the room or in another object's frame."""
    arguments = [handle] if relative_to is None else [handle, relative_to]
    return pose_from(connection.call("getObjectPose", *arguments), connection)


def pose_from(numbers: object, connection: Connection) -> Pose:
    """Of ``[x, y, z, qx, qy, qz, qw]``.

    Raises:
        CoppeliaSimError: it is nothing of the kind.
    """
    x = finite(numbers, 7, connection)
    try:
        return Pose.from_quaternion((x[6], x[3], x[4], x[5]), x[:3])
    except ValueError:
        raise CoppeliaSimError(
            f"CoppeliaSim at {connection.address} gives a pose that is none: {numbers!r}"
        ) from None


def pose_numbers(pose: Pose) -> list[float]:
    """The inverse of ``pose_from``."""
    w, x, y, z = pose.quaternion_wxyz.tolist()
    return [*pose.translation.tolist(), x, y, z, w]


def finite(numbers: object, count: int, connection: Connection) -> Float64Array:
    """(count,) numbers that the simulator gave.

    Raises:
        CoppeliaSimError: they are not so many, or not finite.
    """
    if isinstance(numbers, Sequence) and len(numbers) == count:
        try:
            values = np.array(numbers, dtype=np.float64)
        except (TypeError, ValueError):
            values = np.full(count, math.nan)
        if np.isfinite(values).all():
            return values
    raise CoppeliaSimError(
        f"CoppeliaSim at {connection.address} gives {str(numbers)[:80]} where {count} numbers "
        f"belong"
    )


def number(value: object, connection: Connection) -> float:
    """A number that the simulator gave.

    Raises:
        CoppeliaSimError: it is none.
    """
    return float(finite([value], 1, connection)[0])


def handles(found: object) -> list[int]:
    """A list of handles; Lua has one kind of empty table, which may come as an empty map."""
    return [int(h) for h in found] if isinstance(found, list | tuple) else []


def bounds(
    connection: Connection, handle: int, *, model: bool
) -> tuple[Float64Array, Float64Array]:
    """Lower and upper corner (3,) of an object's box in its own frame, metres.

    Args:
        model: of all that belongs to the model whose base it is.
    """
    prefix = "modelbbox" if model else "objbbox"
    corners = [
        [
            number(
                connection.call(
                    "getObjectFloatParam",
                    handle,
                    connection.constant(f"objfloatparam_{prefix}_{end}_{axis}"),
                ),
                connection,
            )
            for axis in "xyz"
        ]
        for end in ("min", "max")
    ]
    return np.array(corners[0]), np.array(corners[1])

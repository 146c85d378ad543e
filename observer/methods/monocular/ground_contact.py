"""Ground contact of an obstacle: its lowest edge in the image, and that place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.monocular.ground import GroundView
from observer.types import Image

# The lowest points lie at this percentile of the rows, so that a stray one does not count; the box
# has a margin around the points.
_LOWEST_PERCENT, _MARGIN_PX = 92.0, 3.0
# Of the box: the middle part of its width that is looked at, and how far above and below its
# lowest points the obstacle may end, as shares of width and height.
_MIDDLE = 0.35
_ABOVE, _BELOW = 0.2, 0.4
_LEAST_PX = 4.0
# An edge is one from this slope on, grey levels/px; at the end of the search it counts this much.
_LEAST_EDGE, _FAR_WEIGHT = 3.0, 0.3

Box = tuple[float, float, float, float]


def box_around(px: NDArray[np.float32]) -> Box:
    """The box u0, v0, u1, v1 of points (N, 2), with a margin."""
    (u0, v0), (u1, v1) = px.min(axis=0) - _MARGIN_PX, px.max(axis=0) + _MARGIN_PX
    return float(u0), float(v0), float(u1), float(v1)


def lowest_row(px: NDArray[np.float32]) -> float:
    """The row of the lowest points (N, 2), but for a stray one."""
    return float(np.percentile(px[:, 1], _LOWEST_PERCENT))


def lower_edge(image: Image, box: Box, lowest: float) -> float | None:
    """The row, pixels, at which the obstacle in the box u0, v0, u1, v1 ends below.

    The strongest edge across the middle of the box about its lowest points, at the row
    ``lowest``: there it stands against the ground. None where no edge stands out or the image ends
    first.
    """
    u0, v0, u1, _ = box
    height, width = image.shape
    middle, half = (u0 + u1) / 2, max(_MIDDLE * (u1 - u0), 2.0)
    left, right = int(max(middle - half, 0)), int(min(middle + half + 1, width))
    above = max(_ABOVE * (lowest - v0), _LEAST_PX)
    below = max(_BELOW * (lowest - v0), _LEAST_PX)
    top, bottom = int(max(lowest - above, 0)), int(min(lowest + below + 1, height))
    if right - left < 3 or bottom - top < 5:
        return None
    rows = image[top:bottom, left:right].astype(np.float64).mean(axis=1)
    slope = np.abs(rows[2:] - rows[:-2]) / 2
    row = np.arange(top + 1, bottom - 1)
    away = np.where(row > lowest, (row - lowest) / below, (lowest - row) / above)
    edge = int(np.argmax(slope * (1 - (1 - _FAR_WEIGHT) * np.minimum(away, 1.0))))
    if slope[edge] < _LEAST_EDGE or row[edge] >= height - 3:
        return None
    return float(row[edge])


def ground_place(
    px: tuple[float, float], sigma_px: tuple[float, float], view: GroundView
) -> tuple[Float64Array, Float64Array] | None:
    """Project a pixel onto the ground: (2,) metres in its axes, and covariance (2, 2).

    None above the horizon. The covariance is that of the pixel alone; see ``shared_covariance``.
    """
    place, axes = view.contact(np.asarray(px)), view.ground.axes
    if place is None:
        return None
    columns = []
    for step in ((1.0, 0.0), (0.0, -1.0)):
        moved = view.contact(np.add(px, step))
        if moved is None:
            return None
        columns.append(axes.T @ (moved - place))
    J = np.stack(columns, axis=1)
    return axes.T @ place, J @ np.diag(np.square(sigma_px)) @ J.T


def shared_covariance(
    place: Float64Array, view: GroundView, height_sigma: float, tilt_sigma: float
) -> Float64Array:
    """(2, 2) m^2, ground axes: by how much a wrong height and tilt move a place (2,) on the ground.

    Args:
        height_sigma: as a share of the height. tilt_sigma: radians.
    """
    gap, reach, height = _reach(place, view)
    along = gap / max(reach, 1e-9)
    by_tilt = (reach**2 / height + height) * tilt_sigma
    return np.asarray(
        height_sigma**2 * np.outer(gap, gap) + by_tilt**2 * np.outer(along, along), np.float64
    )


def shared_velocity_covariance(
    place: Float64Array,
    velocity: Float64Array,
    view: GroundView,
    height_sigma: float,
    tilt_sigma: float,
) -> Float64Array:
    """(2, 2) (m/s)^2: the same of a velocity (2,) against the camera, in the ground's axes.

    A distance r = h / tan(angle) that is wrong by a share is so for all that moves there; a wrong
    tilt makes the share grow with the distance, and the velocity along it wrong twice as much.
    """
    gap, reach, height = _reach(place, view)
    along = gap / max(reach, 1e-9)
    across = np.array([-along[1], along[0]])
    share = tilt_sigma * (reach / height + height / max(reach, height))
    tilted = 2 * share * (velocity @ along) * along + share * (velocity @ across) * across
    return np.asarray(
        height_sigma**2 * np.outer(velocity, velocity) + np.outer(tilted, tilted), np.float64
    )


def _reach(place: Float64Array, view: GroundView) -> tuple[Float64Array, float, float]:
    gap = place - view.here
    height = max(float(view.ground.height_of(view.T_world_camera.translation)), 1e-3)
    return gap, float(np.linalg.norm(gap)), height

"""Ground contact of an obstacle: its lowest edge in the image, and the place on the ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.monocular.ground import GroundView
from observer.types import BoxPx, Image

# Percentile of the points' rows taken as the lowest, to ignore a stray one; and the margin of the
# box around the points.
_LOWEST_PERCENT, _MARGIN_PX = 92.0, 3.0
# Share of the box's width searched to either side of its middle; and how far above and below its
# lowest points the obstacle may end, as shares of the height.
_MIDDLE = 0.35
_ABOVE, _BELOW = 0.2, 0.4
_LEAST_PX = 4.0
# Grey levels/px: least slope of an edge; and its weight at the end of the search range.
_LEAST_EDGE, _FAR_WEIGHT = 3.0, 0.3


def box_around(px: NDArray[np.float32]) -> BoxPx:
    """Return the box u0, v0, u1, v1 of points (N, 2), with a margin."""
    (u0, v0), (u1, v1) = px.min(axis=0) - _MARGIN_PX, px.max(axis=0) + _MARGIN_PX
    return float(u0), float(v0), float(u1), float(v1)


def lowest_row(px: NDArray[np.float32]) -> float:
    """Return the row of the lowest points (N, 2), ignoring stray ones."""
    return float(np.percentile(px[:, 1], _LOWEST_PERCENT))


def lower_edge(image: Image, box: BoxPx, lowest: float) -> float | None:
    """Return the row, pixels, of the lower edge of the obstacle in the box u0, v0, u1, v1.

    It is the strongest edge across the middle of the box near its lowest points, at the row
    ``lowest``: the contrast against the ground. None if no edge stands out or the image ends first.
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
    """(2, 2) m^2, ground axes: covariance of a ground place (2,) from errors of height and tilt.

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
    """(2, 2) (m/s)^2: the same for a velocity (2,) relative to the camera, in the ground's axes.

    A relative error of the distance r = h / tan(angle) scales all velocities there alike. A wrong
    tilt makes that error grow with the distance, and doubles it for the velocity along it.
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

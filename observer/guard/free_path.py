"""Free ground ahead, seen in one rectified pair by coarse dense stereo.

Block matching assumes surfaces that face the camera, and the floor does not. So the pair is
matched twice: as it is, for standing objects, and with the right image shifted by the disparity
that the floor must have (linear in the pixel, as for every plane), so that the floor faces the
camera (ground plane stereo; Burt, Wixson and Salgian, Electronically directed focal stereo, ICCV
1995).

Only matched floor is *seen* to be free. An object at least ``step_m`` high at distance r hides the
floor from r to r / (1 - step_m / H), H being the camera's height, so floor that is seen at
distance D also shows that nothing stands between D (1 - step_m / H) and D. Whatever was matched
higher than that and lower than the robot's height is in the way. Everything else is unknown:
what is nearer than f B / d_max or below the lower edge of the view, has no texture, or is
occluded. A hanging object is noticed only where it has texture, and only from farther away than
f B / d_max; ``seen_surfaces`` remembers it from there on.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array
from observer.guard.parameters import GuardParameters
from observer.guard.seen_ground import ScanView
from observer.guard.sight import FreeScan
from observer.mount import CameraMount
from observer.types import Image
from observer.vision.stereo import FIXED_POINT

# Approximate number of columns that are matched, whatever the image's size.
_COLUMNS = 256
_BLOCK_PX = 9
_UNIQUENESS_PERCENT = 10
_TEXTURE = 10
_SPECKLE_PIXELS = 30
# One standard deviation of a coarse disparity, coarse pixels.
_SIGMA_PX = 0.25
# How many of them separate an object from the floor; not ``guard.sigmas``, since more caution must
# not hide low objects.
_FLOOR_SIGMAS = 2.0
# Disparities searched about the floor's own: lowest offset and number, coarse pixels.
_FLOOR_LEAST, _FLOOR_DISPARITIES = -8, 32
# Angular width of a direction, and ratio of the far to the near edge of a floor cell.
_BEARING_RAD = math.radians(1.5)
_CELL = 1.08
_NEAREST_M, _FARTHEST_M = 0.25, 5.0
# Depth down to which surfaces are searched, metres.
_NEAREST_SURFACE_M = 0.4
# Share, and number, of a floor cell's pixels that must be matched as floor.
_FLOOR_SHARE = 0.5
_FLOOR_PIXELS = 3
# Minimum number of pixels of a surface: fewer are mismatches.
_SURFACE_PIXELS = 4
# Step between distances along a direction from the base's origin.
_STEP_M = 0.04


class FreePath:
    """Finds the free floor in pairs of one camera on one mount; precomputes their geometry."""

    def __init__(self, camera: StereoCamera, mount: CameraMount, p: GuardParameters) -> None:
        self.made_of = (camera, mount, p)
        self._parameters = p
        self._factor = max(1, math.ceil(camera.width / _COLUMNS))
        width, height = camera.width // self._factor, camera.height // self._factor
        self._size = (width, height)
        # Not as of the stereo stage: nobody who tunes that may make the guard blind.
        disparities = camera.fb / (_NEAREST_SURFACE_M * self._factor)
        self._disparities = 16 * min(max(1, math.ceil(disparities / 16)), max(1, width // 32))
        self._standing = _matcher(0, self._disparities)
        self._floor = _matcher(_FLOOR_LEAST, _FLOOR_DISPARITIES)
        self._origin = mount.T_base_camera.translation
        self._lay_out(camera, mount, p)

    def _lay_out(self, camera: StereoCamera, mount: CameraMount, p: GuardParameters) -> None:
        """Precompute everything about the coarse pixels that does not depend on the image."""
        width, height = self._size
        f = self._factor
        # Pixel centres have integer coordinates, so scale about the pixels' edges.
        u = (np.arange(width) + 0.5) * f - 0.5
        v = (np.arange(height) + 0.5) * f - 0.5
        rays = np.empty((height, width, 3))
        rays[..., 0] = (u - camera.cx) / camera.fx
        rays[..., 1] = ((v - camera.cy) / camera.fy)[:, None]
        rays[..., 2] = 1.0
        rays = rays @ mount.R_base_camera.T
        self._fb = camera.fb / f
        self._rise = rays[..., 2].astype(np.float32)
        self._ahead = np.hypot(rays[..., 0], rays[..., 1]).astype(np.float32)
        bearing = np.arctan2(rays[..., 1], rays[..., 0])
        low, high = float(bearing.min()), float(bearing.max())
        count = max(2, math.ceil((high - low) / _BEARING_RAD))
        edges = np.linspace(low, high, count + 1)
        column = np.clip(np.searchsorted(edges, bearing, side="right") - 1, 0, count - 1)
        self._bearings = (edges[:-1] + edges[1:]) / 2
        cells = math.ceil(math.log(_FARTHEST_M / _NEAREST_M) / math.log(_CELL))
        self._edges = _NEAREST_M * _CELL ** np.arange(cells + 1)
        with np.errstate(divide="ignore"):
            floor = np.where(rays[..., 2] < 0, -mount.height_m / rays[..., 2], np.inf)
        floor = floor * self._ahead
        cell = np.searchsorted(self._edges, floor, side="right") - 1
        inside = (cell >= 0) & (cell < cells)
        self._shape = (count, cells)
        # Pixels outside all cells are counted in an extra cell after the last.
        self._cell = np.where(inside, column * cells + cell, count * cells).astype(np.intp)
        total = np.bincount(self._cell.ravel(), minlength=count * cells + 1)[:-1]
        self._needed = np.maximum(_FLOOR_SHARE * total, _FLOOR_PIXELS).reshape(self._shape)
        self._column = column.astype(np.intp)
        self._height = mount.height_m
        # Disparity of the floor at each pixel; above the horizon there is no floor.
        floor_px = np.maximum(-self._rise * np.float32(self._fb / mount.height_m), 0.0)
        below = np.nonzero((floor_px > 0).any(axis=1))[0]
        self._first_row = int(below[0]) if len(below) else height
        self._floor_px = np.ascontiguousarray(floor_px[self._first_row :], np.float32)
        columns = np.arange(width, dtype=np.float32)
        self._shift = (
            columns - self._floor_px,
            np.repeat(
                np.arange(height - self._first_row, dtype=np.float32)[:, None], width, axis=1
            ),
        )
        self._in_right = self._shift[0] >= 0
        hidden = 1 - min(p.step_m / mount.height_m, 0.5)
        # Whole cells in front of a seen one in which an object would have hidden it.
        self._cleared_before = int(-math.log(hidden) / math.log(_CELL))
        self._reach = np.arange(_STEP_M, _FARTHEST_M, _STEP_M)
        directions = np.stack([np.cos(self._bearings), np.sin(self._bearings)], axis=1)
        self._blind = self._blind_about_the_base(column, directions)
        ground = directions[:, None] * self._reach[:, None]
        # The scan's bearings are from the base's origin, those of the pixels from the camera.
        self._ground = (ground - self._origin[:2]).reshape(-1, 2)

    def scan(self, left: Image, right: Image) -> FreeScan:
        """The free floor of a pair.

        Args:
            left, right: (H, W) grey, rectified, of the camera's size.
        """
        small = [self._coarse(image) for image in (left, right)]
        nearest = self._nearest(*self._surfaces(*small))
        return self._about_the_base(self._free_cells(self._floor_seen(*small)), nearest)

    def _coarse(self, image: Image) -> Image:
        whole = image[: self._size[1] * self._factor, : self._size[0] * self._factor]
        small = cv2.resize(whole, self._size, interpolation=cv2.INTER_AREA)
        return np.asarray(small, np.uint8)

    def _surfaces(self, left: Image, right: Image) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
        """Distance and direction of every pixel that shows something in the way."""
        # The matcher omits as many columns at the left as it searches disparities.
        margin, p = self._disparities, self._parameters
        wide = [
            cv2.copyMakeBorder(one, 0, 0, margin, 0, cv2.BORDER_REPLICATE) for one in (left, right)
        ]
        fixed = np.asarray(self._standing.compute(wide[0], wide[1]))[:, margin:]
        inside = fixed <= FIXED_POINT * np.arange(self._size[0])
        known = np.nonzero((fixed > 0) & inside)
        depth = np.float32(self._fb * FIXED_POINT) / fixed[known]
        sigma = depth * depth * np.float32(_SIGMA_PX / self._fb)
        rise, ahead = self._rise[known], self._ahead[known]
        height = np.float32(self._height) + rise * depth
        standing = height > np.float32(p.step_m) + np.abs(rise) * sigma * np.float32(_FLOOR_SIGMAS)
        standing &= height < p.robot_height_m
        distance = (ahead * (depth - sigma * np.float32(p.sigmas)))[standing]
        return distance, self._column[known][standing]

    def _nearest(self, distance: NDArray[np.float32], column: NDArray[np.intp]) -> Float64Array:
        """(N,) nearest surface in each direction from the camera, infinite where none is seen."""
        cells = len(self._reach)
        at = np.maximum((distance / np.float32(_STEP_M)).astype(np.intp), 0)
        seen = at < cells
        count = np.bincount(column[seen] * cells + at[seen], minlength=self._shape[0] * cells)
        enough = count.reshape(self._shape[0], cells).cumsum(axis=1) >= _SURFACE_PIXELS
        return np.where(enough.any(axis=1), enough.argmax(axis=1) * _STEP_M, np.inf)

    def _floor_seen(self, left: Image, right: Image) -> NDArray[np.bool_]:
        """(H, W) which pixels show the floor."""
        seen = np.zeros((self._size[1], self._size[0]), np.bool_)
        first = self._first_row
        if self._size[1] - first <= _BLOCK_PX:
            return seen
        shifted = cv2.remap(right[first:], *self._shift, cv2.INTER_LINEAR)
        # Pad both sides: for negative disparities the matcher also omits columns at the right.
        before, behind = _FLOOR_DISPARITIES, -_FLOOR_LEAST
        wide = [
            cv2.copyMakeBorder(one, 0, 0, before, behind, cv2.BORDER_REPLICATE)
            for one in (left[first:], np.asarray(shifted, np.uint8))
        ]
        fixed = np.asarray(self._floor.compute(wide[0], wide[1]))[:, before:-behind]
        off = fixed.astype(np.float32) / np.float32(FIXED_POINT)
        # A point at height h differs from the floor's own disparity by h / (H - h) of it.
        tolerance = np.float32(self._parameters.step_m / self._height) * self._floor_px
        tolerance += np.float32(_FLOOR_SIGMAS * _SIGMA_PX)
        seen[first:] = (np.abs(off) <= tolerance) & self._in_right
        return seen

    def _free_cells(self, floor: NDArray[np.bool_]) -> NDArray[np.bool_]:
        count = np.bincount(self._cell[floor], minlength=self._needed.size + 1)[:-1]
        seen = count.reshape(self._shape) >= self._needed
        seen = np.asarray(seen, np.bool_)
        free = seen.copy()
        for before in range(1, self._cleared_before + 1):
            free[:, :-before] |= seen[:, before:]
        return free

    def _about_the_base(self, free: NDArray[np.bool_], nearest: Float64Array) -> FreeScan:
        """The longest free stretch before the nearest surface, by direction from the base."""
        near, far = self._stretch(free, nearest)
        view = ScanView.of(
            FreeScan(
                tuple(self._bearings.tolist()),
                tuple(None if math.isinf(b) else b for b in nearest.tolist()),
                tuple(near.tolist()),
                tuple(far.tolist()),
            )
        )
        seen, blocked = (
            one.reshape(len(self._bearings), -1) for one in view.classify(self._ground)
        )
        first_blocked = np.where(blocked.any(axis=1), blocked.argmax(axis=1), blocked.shape[1])
        seen &= np.arange(seen.shape[1]) < first_blocked[:, None]
        begins, lengths = _longest_run(seen)
        from_m = self._reach[begins]
        to_m = np.where(lengths > 0, self._reach[np.maximum(begins + lengths - 1, 0)], from_m)
        surfaces = [float(self._reach[k]) if k < len(self._reach) else None for k in first_blocked]
        return FreeScan(
            tuple(round(b, 4) for b in self._bearings.tolist()),
            tuple(None if b is None else round(b, 3) for b in surfaces),
            tuple(round(b, 3) for b in from_m.tolist()),
            tuple(round(b, 3) for b in to_m.tolist()),
            self._blind,
        )

    def _blind_about_the_base(
        self, column: NDArray[np.intp], directions: Float64Array
    ) -> tuple[float, ...]:
        """(N,) distance in each direction from the base below which no surface can be matched.

        Args:
            column: (H, W) direction of every pixel. directions: (N, 2) unit vectors.
        """
        ahead = np.zeros(len(directions))
        np.maximum.at(ahead, column.ravel(), self._ahead.ravel())
        nearest = self._fb / (self._disparities - 1)
        places = self._origin[:2] + nearest * ahead[:, None] * directions
        bearing = np.arctan2(places[:, 1], places[:, 0])
        order = np.argsort(bearing)
        blind = np.interp(self._bearings, bearing[order], np.hypot(*places.T)[order])
        return tuple(round(b, 3) for b in blind.tolist())

    def _stretch(
        self, free: NDArray[np.bool_], nearest: Float64Array
    ) -> tuple[Float64Array, Float64Array]:
        before = free & (self._edges[:-1] < nearest[:, None])
        begins, lengths = _longest_run(before)
        near = self._edges[begins]
        far = np.minimum(self._edges[begins + lengths], nearest)
        return np.where(lengths > 0, near, 0.0), np.where(lengths > 0, far, 0.0)


def _matcher(least: int, count: int) -> cv2.StereoBM:
    matcher = cv2.StereoBM.create(count, _BLOCK_PX)
    matcher.setMinDisparity(least)
    matcher.setUniquenessRatio(_UNIQUENESS_PERCENT)
    matcher.setTextureThreshold(_TEXTURE)
    matcher.setDisp12MaxDiff(1)
    matcher.setSpeckleWindowSize(_SPECKLE_PIXELS)
    matcher.setSpeckleRange(1)
    return matcher


def _longest_run(flags: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return start and length of the longest run of True in each row (N, M)."""
    edge = np.diff(np.pad(flags, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    rows, begins = np.nonzero(edge == 1)
    lengths = np.nonzero(edge == -1)[1] - begins
    best, start = np.zeros(len(flags), np.intp), np.zeros(len(flags), np.intp)
    # The last write wins: the longest run.
    order = np.argsort(lengths, kind="stable")
    best[rows[order]], start[rows[order]] = lengths[order], begins[order]
    return start, best

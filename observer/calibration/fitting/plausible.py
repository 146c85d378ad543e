"""Checks that views determine a calibration, and that it is physically plausible."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from observer.calibration.fitting.adjustment import Adjusted, StereoModel
from observer.camera import FOCAL_SHARES
from observer.errors import CalibrationError

# Standard deviation of the focal length, as a share of it, above which it counts as undetermined:
# for one camera alone, and for the pair.
_UNSURE_ALONE, _UNSURE = 0.1, 0.02
# Smaller differences between two poses of the board count as the same pose: degrees, and a share of
# the distance.
_SAME_DEG, _SAME_SHARE = 4.0, 0.05
_FEWEST_POSES = 3
# Degrees of tilt below which the board faces the camera.
_FACING_DEG = 10.0
_LARGE_RMS_PX = 3.0


def check_camera(found: Adjusted, seen: NDArray[np.intp], name: str) -> None:
    """Check that the views determine this camera's lens.

    Args:
        seen: numbers of the views used. name: of the camera, as in ``the left camera``.

        Raises:
            CalibrationError: they do not, or the lens is impossible.
    """
    _check_lens(found.model, 0, seen, name)
    _check_variety(found.model, seen)
    _check_focal(found, seen, (name,), name, _UNSURE_ALONE)


def check_pair(found: Adjusted, seen: NDArray[np.intp]) -> None:
    """Check that the views determine this pair, and that it can be a pair of stereo cameras.

    Raises:
        CalibrationError: they do not, or it cannot.
    """
    model, scatter = found.model, found.scatter_px
    if not scatter < _LARGE_RMS_PX:
        raise CalibrationError(
            f"the overall reprojection error is {scatter:.1f} px, 0.1 to 0.5 px is usual; check "
            "the number of corners of the board, and that the images are sharp and correctly paired"
        )
    names = ("the left camera", "the right camera")
    for camera, name in enumerate(names):
        _check_lens(model, camera, seen, name)
    _check_focal(found, seen, names, "the pair", _UNSURE)
    x, y, z = (-model.R.T @ model.T).tolist()
    if abs(x) <= max(abs(y), abs(z)):
        raise CalibrationError(
            f"the right camera is {x:.3f} m to the right of, {y:.3f} m below and {z:.3f} m in "
            "front of the left one; the two must be side by side"
        )
    if x < 0:
        raise CalibrationError(
            f"the right camera is {1e3 * -x:.0f} mm to the left of the left one; swap the left and "
            "right images"
        )


def _check_lens(model: StereoModel, camera: int, seen: NDArray[np.intp], name: str) -> None:
    """Check that the lens is possible for an image of this size.

    Raises:
        CalibrationError: it cannot.
    """
    width, height = model.size
    fx, fy, cx, cy = model.lenses[camera].values[:4].tolist()
    low, high = FOCAL_SHARES
    if not (low * width < fx < high * width and 0.5 < fy / fx < 2):
        raise CalibrationError(
            f"the views of {name} give an impossible focal length ({fx:.4g} x {fy:.4g} pixels "
            f"for an image of {width}x{height}); {_advice(model, seen, camera)}"
        )
    if not (-0.25 * width < cx < 1.25 * width and -0.25 * height < cy < 1.25 * height):
        raise CalibrationError(
            f"the views of {name} place its principal point at {cx:.0f}, {cy:.0f}, far outside the "
            f"image of {width}x{height} pixels; {_advice(model, seen, camera)}"
        )


def _check_focal(
    found: Adjusted, seen: NDArray[np.intp], names: Sequence[str], whole: str, most: float
) -> None:
    """Check that the focal lengths are known to a share of ``most``.

    Args:
        names: of the cameras. whole: name to use if nothing at all is determined.

    Raises:
        CalibrationError: they are not.
    """
    model, covariance = found.model, found.covariance
    if covariance is None:
        raise CalibrationError(_undetermined(model, seen, whole))
    for camera, name in enumerate(names):
        at = camera * model.free_count
        share = float(np.sqrt(covariance[at, at])) / float(model.lenses[camera].values[0])
        if not share < most:
            raise CalibrationError(_undetermined(model, seen, name, share))


def _check_variety(model: StereoModel, seen: NDArray[np.intp]) -> None:
    """Check that the board was held in enough poses; without noise, one would seem enough.

    Raises:
        CalibrationError: it was not.
    """

    def alike(index: int, other: int) -> bool:
        R, t = model.board_R, model.board_t
        turned = R[index] @ R[other].T
        angle = np.degrees(np.arccos(np.clip((np.trace(turned) - 1) / 2, -1, 1)))
        moved = np.linalg.norm(t[index] - t[other])
        return bool(angle < _SAME_DEG and moved < _SAME_SHARE * np.linalg.norm(t[index]))

    different: list[int] = []
    for index in seen.tolist():
        if not any(alike(index, other) for other in different):
            different.append(index)
    if len(different) < _FEWEST_POSES:
        raise CalibrationError(
            f"the board is in only {len(different)} different "
            f"pose{'' if len(different) == 1 else 's'} in {len(seen)} views; move and tilt it "
            f"between views: {_FEWEST_POSES} poses are needed, and 15 are recommended"
        )


def _undetermined(
    model: StereoModel, seen: NDArray[np.intp], name: str, share: float | None = None
) -> str:
    known = "" if share is None or not share < 9 else f" (known only to {100 * share:.0f} %)"
    return (
        f"the views do not determine the focal length of {name}{known}; "
        f"{_advice(model, seen, 0 if 'left' in name else len(model.lenses) - 1)}"
    )


def _advice(model: StereoModel, seen: NDArray[np.intp], camera: int) -> str:
    """Return what to do differently, judging by how the board was held."""
    R = model.board_R[seen]
    if camera == 1:
        R = model.R @ R
    normal = R[:, :, 2]
    middle = np.median(normal, axis=0)
    middle /= max(float(np.linalg.norm(middle)), 1e-9)
    turned = np.degrees(np.arccos(np.clip(normal @ middle, -1, 1)))
    facing = np.degrees(np.arccos(np.clip(np.abs(normal[:, 2]), 0, 1)))
    if np.percentile(facing, 90) < _FACING_DEG or turned.max(initial=0) < _SAME_DEG:
        return (
            "the board faces the camera the same way in every view, so that a longer lens and a "
            "greater distance look the same: tilt it by 20 to 40 degrees, to each side, up and down"
        )
    return (
        "show the board closer and tilted by 20 to 40 degrees to each side, so that it fills most "
        "of the image"
    )

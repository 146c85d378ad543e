"""The camera's own motion and stereo: what more than one method goes by."""

from __future__ import annotations

from typing import Literal

from observer.parameters.fields import FOLLOWING, SAMPLING, Real, Stage, Whole, choice, number


class EgoMotionParameters(Stage):
    """The camera's own motion, by RANSAC; the model decides how moving obstacles are found."""

    model: Literal["rigid", "homography", "affine", "one_camera"] = choice(
        "rigid", title="Model",
        help="rigid is the motion in space, by stereo, and tells motion from parallax. The planar "
        "ones map image to image: affine has six parameters and is the paper's, homography has "
        "eight and also fits a plane seen in perspective. one_camera looks at the left image "
        "alone. Between rigid, one_camera and a planar one the next frame begins a new segment.",
    )
    ransac_threshold_px: Real = number(
        1.2, ge=0.1, le=20.0, unit="px", step=0.1, title="RANSAC threshold",
        help="A match counts as background if the model explains it within this distance.",
        models=SAMPLING,
    )
    ransac_iterations: Whole = number(
        500, ge=10, le=10000, unit="iterations", step=10, title="RANSAC iterations",
        help="Most samples tried. Fewer are faster and may miss the background.",
        models=SAMPLING,
    )
    min_inliers: Whole = number(
        12, ge=4, le=500, unit="matches", step=1, title="Fewest inliers",
        help="With fewer background matches the camera's motion counts as lost.",
    )
    shared_error: Real = number(
        0.02, ge=0.0, le=1.0, unit="", step=0.01, title="Shared error",
        help="Share of the noise that points have in common.", models=FOLLOWING,
    )
    recover_frames: Whole = number(
        5, ge=0, le=60, unit="frames", step=1, title="Recover within",
        help="While the camera's motion is lost, frames are compared with the last good one for "
        "this long; then all tracks end and a new segment begins.",
    )


class StereoParameters(Stage):
    """Disparity and depth: of the planar models and, with every model, of the cloud that is
    shown. Rigid measures the disparity of its points alone, up to the largest one."""

    matcher: Literal["bm", "sgbm"] = choice(
        "sgbm", title="Matcher",
        help="bm is block matching, fast and sparse; sgbm is semi-global matching, denser.",
    )
    max_disparity_px: Whole = number(
        96, ge=16, le=256, unit="px", step=16, title="Largest disparity",
        help="Sets the nearest depth that can be measured; rounded up to a multiple of 16.",
    )
    block_px: Whole = number(
        7, ge=5, le=31, unit="px", step=2, title="Block size",
        help="Side of the compared block; even values are rounded up.",
    )
    uniqueness_percent: Whole = number(
        8, ge=0, le=50, unit="%", step=1, title="Uniqueness",
        help="How much better than the second best the best disparity must be.",
    )
    min_depth_m: Real = number(
        0.2, ge=0.05, le=10.0, unit="m", step=0.05, title="Nearest depth",
        help="Points nearer than this are left out.",
    )
    max_depth_m: Real = number(
        30.0, ge=0.5, le=200.0, unit="m", step=0.5, title="Farthest depth",
        help="Points farther than this are left out.",
    )

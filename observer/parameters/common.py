"""The camera's own motion, features and stereo: what more than one method goes by."""

from __future__ import annotations

from typing import Literal

from observer.parameters.fields import (
    KLT,
    PLANAR,
    SAMPLING,
    Real,
    Stage,
    Whole,
    choice,
    number,
)


class EgoMotionParameters(Stage):
    """The camera's own motion, by RANSAC; the model decides how moving obstacles are found."""

    model: Literal["rigid", "homography", "affine", "monocular"] = choice(
        "rigid",
        title="Model",
        help="rigid is the motion in space, by stereo, and tells motion from parallax. The planar "
        "ones map image to image: affine has six parameters and is the paper's, homography has "
        "eight and also fits a plane seen in perspective. one_camera looks at the left image "
        "alone. Between rigid, one_camera and a planar one the next frame begins a new segment.",
    )
    ransac_threshold_px: Real = number(
        1.2,
        ge=0.1,
        le=20.0,
        unit="px",
        step=0.1,
        title="RANSAC threshold",
        help="A match counts as background if the model explains it within this distance.",
        models=SAMPLING,
    )
    ransac_iterations: Whole = number(
        500,
        ge=10,
        le=10000,
        unit="iterations",
        step=10,
        title="RANSAC iterations",
        help="Most samples tried. Fewer are faster and may miss the background.",
        models=SAMPLING,
    )
    min_inliers: Whole = number(
        12,
        ge=4,
        le=500,
        unit="matches",
        step=1,
        title="Fewest inliers",
        help="With fewer background matches the camera's motion counts as lost.",
    )
    noise_correlation: Real = number(
        0.02,
        ge=0.0,
        le=1.0,
        unit="",
        step=0.01,
        title="Shared error",
        help="Share of the noise that points have in common.",
        models=KLT,
    )
    recover_frames: Whole = number(
        5,
        ge=0,
        le=60,
        unit="frames",
        step=1,
        title="Recover within",
        help="While the camera's motion is lost, frames are compared with the last good one for "
        "this long; then all tracks end and a new segment begins.",
    )


class FeaturesParameters(Stage):
    """Feature points: of the planar models on the image at t, of rigid and one_camera in every
    square (klt_tracking.spacing_px) in which no point is followed."""

    detector: Literal["fast", "shi_tomasi", "harris", "brisk", "kaze", "mser", "orb", "surf"] = (
        choice(
            "shi_tomasi",
            title="Detector",
            help="Which feature points are used. shi_tomasi is the minimum eigenvalue, by which "
            "points can be followed best, harris is Harris-Stephens; the paper uses FAST. "
            "surf is installed by: pip install 'dynamic-observer[surf]'.",
        )
    )
    max_count: Whole = number(
        600,
        ge=50,
        le=4000,
        unit="points",
        step=50,
        title="Most features",
        help="The strongest points kept, spread over the image by the grid.",
        models=PLANAR,
    )
    grid_cells: Whole = number(
        8,
        ge=1,
        le=32,
        unit="cells",
        step=1,
        title="Grid columns",
        help="The image is divided into this many columns of square cells, each with an equal "
        "share of the features; 1 keeps the strongest wherever they are.",
        models=PLANAR,
    )
    fast_threshold: Whole = number(
        12,
        ge=2,
        le=100,
        unit="grey levels",
        step=1,
        title="FAST threshold",
        help="Least difference between a corner and the circle around it, for fast, brisk and orb.",
    )
    quality: Real = number(
        0.01,
        ge=0.0005,
        le=0.5,
        unit="",
        step=0.0005,
        title="Corner quality",
        help="Least corner measure of shi_tomasi and harris, relative to the strongest corner.",
        models=PLANAR,
    )


class StereoParameters(Stage):
    """Disparity and depth: of the planar models and, with every model, of the cloud that is
    shown. Rigid measures the disparity of its points alone, up to the largest one."""

    matcher: Literal["bm", "sgbm"] = choice(
        "sgbm",
        title="Matcher",
        help="bm is block matching, fast and sparse; sgbm is semi-global matching, denser.",
    )
    max_disparity_px: Whole = number(
        96,
        ge=16,
        le=256,
        unit="px",
        step=16,
        title="Largest disparity",
        help="Sets the nearest depth that can be measured; rounded up to a multiple of 16.",
    )
    block_px: Whole = number(
        7,
        ge=5,
        le=31,
        unit="px",
        step=2,
        title="Block size",
        help="Side of the compared block; even values are rounded up.",
    )
    uniqueness_percent: Whole = number(
        8,
        ge=0,
        le=50,
        unit="%",
        step=1,
        title="Uniqueness",
        help="How much better than the second best the best disparity must be.",
    )
    min_depth_m: Real = number(
        0.2,
        ge=0.05,
        le=10.0,
        unit="m",
        step=0.05,
        title="Nearest depth",
        help="Points nearer than this are left out.",
    )
    max_depth_m: Real = number(
        30.0,
        ge=0.5,
        le=200.0,
        unit="m",
        step=0.5,
        title="Farthest depth",
        help="Points farther than this are left out.",
    )

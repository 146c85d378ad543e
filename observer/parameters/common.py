"""Parameters of more than one method: ego-motion, features and stereo."""

from __future__ import annotations

from typing import Literal

from observer.parameters.fields import (
    KLT,
    PLANAR,
    STEREO,
    Model,
    Real,
    Stage,
    Whole,
    choice,
    number,
)


class EgoMotionParameters(Stage):
    """The method and its estimate of the camera's motion."""

    model: Model = choice(
        "rigid",
        title="Method",
        labels={
            "rigid": "Rigid",
            "homography": "Homography",
            "affine": "Affine",
            "monocular": "Monocular",
        },
        basic=True,
    )
    """rigid estimates 3D ego-motion from stereo and separates motion from parallax. The planar
    methods map image to image: affine (six parameters) is the paper's, homography (eight) also fits
    a plane in perspective. monocular uses only the left image. Switching between rigid, monocular
    and the planar methods starts a new segment."""
    ransac_threshold_px: Real = number(
        1.2,
        unit="px",
        ge=0.1,
        le=20.0,
        step=0.1,
        title="RANSAC threshold",
        models=STEREO,
        basic=True,
    )
    """Maximum reprojection error of an inlier."""
    ransac_iterations: Whole = number(
        500, unit="iterations", ge=10, le=10000, step=10, title="RANSAC iterations", models=STEREO
    )
    """Maximum number of samples. Fewer are faster and may miss the background."""
    min_inliers: Whole = number(12, unit="matches", ge=4, le=500, step=1, title="Min. inliers")
    """With fewer inliers the ego-motion counts as lost."""
    noise_correlation: Real = number(
        0.02, ge=0.0, le=1.0, step=0.01, title="Ego-motion noise correlation", models=KLT
    )
    """Share of the measurement noise that all points have in common."""
    recover_frames: Whole = number(
        5, unit="frames", ge=0, le=60, step=1, title="Ego-motion recovery time"
    )
    """While the ego-motion is lost, frames are compared with the last good one; after this many
    frames all tracks end and a new segment starts."""


class FeaturesParameters(Stage):
    """Features: with the planar methods in the image at t, with rigid and monocular in every
    square (klt_tracking.spacing_px) in which no point is tracked."""

    detector: Literal["fast", "shi_tomasi", "harris", "brisk", "kaze", "mser", "orb", "surf"] = (
        choice(
            "shi_tomasi",
            title="Feature detector",
            labels={
                "fast": "FAST",
                "shi_tomasi": "Shi-Tomasi",
                "harris": "Harris",
                "brisk": "BRISK",
                "kaze": "KAZE",
                "mser": "MSER",
                "orb": "ORB",
                "surf": "SURF",
            },
            basic=True,
        )
    )
    """Shi-Tomasi is the minimum eigenvalue, whose points can be tracked best; Harris is
    Harris-Stephens; the paper uses FAST. SURF needs the package mahotas."""
    max_count: Whole = number(
        600, unit="points", ge=50, le=4000, step=50, title="Max. features", models=PLANAR
    )
    """Number of the strongest features that are kept, spread over the grid."""
    grid_cells: Whole = number(
        8, unit="cells", ge=1, le=32, step=1, title="Feature grid columns", models=PLANAR
    )
    """Columns of square cells that get an equal share of the features; 1 keeps the strongest
    anywhere in the image."""
    fast_threshold: Whole = number(
        12, unit="grey levels", ge=2, le=100, step=1, title="FAST threshold"
    )
    """Min. contrast between a corner and the circle around it, for FAST, BRISK and ORB."""
    quality: Real = number(
        0.01, ge=0.0005, le=0.5, step=0.0005, title="Corner quality", models=PLANAR
    )
    """Min. corner measure of Shi-Tomasi and Harris, relative to the strongest corner."""


class StereoParameters(Stage):
    """Dense disparity and depth, for the planar methods and, with every method, for the displayed
    point cloud. rigid uses only stereo.max_disparity_px, for its points and bodies."""

    models = PLANAR
    cloud = True

    matcher: Literal["bm", "sgbm"] = choice(
        "sgbm",
        title="Stereo matcher",
        labels={"bm": "Block matching", "sgbm": "Semi-global matching"},
    )
    """Block matching (bm) is fast and sparse, semi-global matching (sgbm) is denser."""
    max_disparity_px: Whole = number(
        96, unit="px", ge=16, le=256, step=16, title="Max. disparity", models=STEREO
    )
    """Limits the nearest depth that can be measured; rounded up to a multiple of 16."""
    block_px: Whole = number(7, unit="px", ge=5, le=31, step=2, title="Stereo block size")
    """Side of the matched block; even values are rounded up."""
    uniqueness_percent: Whole = number(8, unit="%", ge=0, le=50, step=1, title="Stereo uniqueness")
    """Margin by which the best disparity must beat the second best."""
    min_depth_m: Real = number(
        0.2, unit="m", ge=0.05, le=10.0, step=0.05, title="Min. stereo depth"
    )
    """Nearer points are ignored."""
    max_depth_m: Real = number(
        30.0, unit="m", ge=0.5, le=200.0, step=0.5, title="Max. stereo depth"
    )
    """Farther points are ignored."""

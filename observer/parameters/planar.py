"""Parameters of the planar methods: frames, matching, flow, motion, tracks."""

from __future__ import annotations

from typing import Literal

from observer.parameters.fields import PLANAR, Flag, Real, Stage, Whole, choice, number


class FramesParameters(Stage):
    """Planar methods: which two frames are compared."""

    models = PLANAR

    interval: Whole = number(
        2, unit="frames", ge=1, le=10, step=1, title="Frame interval", basic=True
    )
    """Frames between t and t+dt. A longer interval reveals slower obstacles and increases
    parallax."""


class MatchingParameters(Stage):
    """Planar methods: matching features between t and t+dt."""

    models = PLANAR

    method: Literal["descriptor", "klt"] = choice(
        "klt",
        title="Matching method",
        labels={"descriptor": "Descriptors", "klt": "KLT"},
        basic=True,
    )
    """Descriptors (ORB, or the detector's own) are compared, or KLT tracks each feature by
    Lucas-Kanade."""
    ratio: Real = number(0.85, ge=0.3, le=1.0, step=0.01, title="Descriptor ratio test")
    """Max. distance of the best descriptor match, relative to the second best."""
    cross_check: Flag = choice(True, title="Match cross check")
    """Keep only mutual best matches; with KLT, track back."""
    max_shift: Real = number(
        0.25, unit="image widths", ge=0.01, le=1.0, step=0.01, title="Max. match shift"
    )
    """Matches that move farther between the two images are rejected."""


class FlowParameters(Stage):
    """Planar methods: residual flow by Lucas-Kanade between the image at t and the warped one."""

    models = PLANAR

    window_px: Whole = number(15, unit="px", ge=5, le=51, step=2, title="Flow window size")
    """Side of the Lucas-Kanade window."""
    pyramid_levels: Whole = number(
        3, unit="levels", ge=0, le=6, step=1, title="Flow pyramid levels"
    )
    """Each level doubles the motion that can be tracked."""
    residual_threshold_px: Real = number(
        2.0, unit="px", ge=0.1, le=30.0, step=0.1, title="Flow threshold", basic=True
    )
    """Features with a larger residual flow count as dynamic."""
    min_texture: Real = number(
        1.6, unit="grey levels/px", ge=0.0, le=20.0, step=0.1, title="Min. flow texture"
    )
    """Features whose neighbourhood varies less in any one direction are ignored: along a straight
    edge the flow slides."""
    max_error: Real = number(
        20.0, unit="grey levels", ge=1.0, le=100.0, step=1.0, title="Max. flow match error"
    )
    """Matches whose neighbourhoods differ more on average are rejected."""
    match_brightness: Flag = choice(True, title="Match brightness")
    """Scale the second image to the brightness of the first, against flickering light and automatic
    exposure."""
    back_check_px: Real = number(
        0.7, unit="px", ge=0.05, le=10.0, step=0.05, title="Flow forward-backward error"
    )
    """Max. distance between a feature's start and the place to which it is tracked back."""


class MotionParameters(Stage):
    """Planar methods: the velocity of a dynamic feature from two positions."""

    models = PLANAR

    max_speed_mps: Real = number(
        40.0, unit="m/s", ge=0.1, le=100.0, step=0.1, title="Max. feature speed"
    )
    """Faster displacements are rejected as stereo errors."""
    disparity_sigma_px: Real = number(
        0.2, unit="px", ge=0.05, le=3.0, step=0.05, title="Disparity noise"
    )
    """Standard deviation of a measured disparity."""
    pixel_sigma_px: Real = number(0.3, unit="px", ge=0.05, le=3.0, step=0.05, title="Flow noise")
    """Standard deviation of a tracked position."""
    noise_correlation: Real = number(
        0.15, ge=0.0, le=1.0, step=0.05, title="Velocity noise correlation"
    )
    """Share of the measurement noise that neighbouring points have in common, so that averaging
    does not reduce it."""
    turn_sigma_radps: Real = number(
        0.4, unit="rad/s", ge=0.0, le=5.0, step=0.1, title="Obstacle yaw rate noise"
    )
    """Standard deviation of an obstacle's yaw rate, by which its visible side moves differently
    from its centre."""
    min_significance: Real = number(
        3.0,
        unit="standard deviations",
        ge=0.0,
        le=20.0,
        step=0.5,
        title="Min. significance",
        basic=True,
    )
    """Obstacles whose velocity is less significant against all known errors, including parallax,
    are ignored; 0 keeps all, as in the paper."""


class ClusteringParameters(Stage):
    """Planar methods: grouping dynamic points."""

    models = PLANAR

    radius_m: Real = number(0.3, unit="m", ge=0.02, le=5.0, step=0.01, title="Cluster radius")
    """Dynamic points within this distance, plus depth noise, form one obstacle."""
    min_points: Whole = number(
        4, unit="points", ge=1, le=100, step=1, title="Min. points per cluster", basic=True
    )
    """Smaller clusters are ignored."""


class TrackingParameters(Stage):
    """Planar methods: identities over time."""

    models = PLANAR

    gate: Real = number(0.6, unit="m", ge=0.05, le=10.0, step=0.05, title="Track gate")
    """A cluster farther from every predicted track starts a new track."""
    confirm_hits: Whole = number(
        3, unit="frames", ge=1, le=30, step=1, title="Track confirmation frames"
    )
    """Number of sightings after which a track is reported."""
    coast_frames: Whole = number(5, unit="frames", ge=0, le=60, step=1, title="Track coasting time")
    """Frames after which a track that is no longer seen is dropped."""

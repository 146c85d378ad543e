"""The other stages of the method as published: frames, matching, flow, motion, tracks."""

from __future__ import annotations

from typing import Literal

from observer.parameters.fields import PLANAR, Flag, Real, Stage, Whole, choice, number


class FramesParameters(Stage):
    """Planar models: which two frames are compared. Rigid follows from frame to frame."""

    models = PLANAR

    interval: Whole = number(
        2,
        ge=1,
        le=10,
        unit="frames",
        step=1,
        title="Pair distance",
        help="How many frames lie between t and t+dt. A longer distance makes slow obstacles "
        "visible and parallax worse.",
    )


class MatchingParameters(Stage):
    """Planar models: matching features between t and t+dt."""

    models = PLANAR

    method: Literal["descriptor", "klt"] = choice(
        "klt",
        title="Matching",
        help="descriptor compares feature values (ORB, or the detector's own); klt tracks each "
        "feature by Lucas-Kanade.",
    )
    ratio: Real = number(
        0.85,
        ge=0.3,
        le=1.0,
        unit="",
        step=0.01,
        title="Ratio test",
        help="A match is kept if its distance is below this share of the second best one's.",
    )
    cross_check: Flag = choice(
        True,
        title="Cross check",
        help="Keep only matches that are the best in both directions; with klt, track back.",
    )
    max_shift: Real = number(
        0.25,
        ge=0.01,
        le=1.0,
        unit="image widths",
        step=0.01,
        title="Largest shift",
        help="Matches that move further than this between the two images are refused.",
    )


class FlowParameters(Stage):
    """Planar models: residual motion by Lucas-Kanade between the image at t and the transformed
    one."""

    models = PLANAR

    window_px: Whole = number(
        15,
        ge=5,
        le=51,
        unit="px",
        step=2,
        title="Window",
        help="Side of the Lucas-Kanade window.",
    )
    pyramid_levels: Whole = number(
        3,
        ge=0,
        le=6,
        unit="levels",
        step=1,
        title="Pyramid levels",
        help="Each level doubles the motion that can be followed.",
    )
    residual_threshold_px: Real = number(
        2.0,
        ge=0.1,
        le=30.0,
        unit="px",
        step=0.1,
        title="Flow threshold",
        help="A feature whose residual motion exceeds this counts as dynamic.",
    )
    min_texture: Real = number(
        1.6,
        ge=0.0,
        le=20.0,
        unit="grey levels/px",
        step=0.1,
        title="Least texture",
        help="Features whose surroundings vary less than this in any one direction are left out: "
        "along a straight edge the flow slides.",
    )
    max_error: Real = number(
        20.0,
        ge=1.0,
        le=100.0,
        unit="grey levels",
        step=1.0,
        title="Largest match error",
        help="Features whose surroundings differ more than this on average are left out.",
    )
    match_brightness: Flag = choice(
        True,
        title="Match brightness",
        help="Scale the second image to the brightness of the first, against flickering light "
        "and automatic exposure.",
    )
    back_check_px: Real = number(
        0.7,
        ge=0.05,
        le=10.0,
        unit="px",
        step=0.05,
        title="Backward check",
        help="A feature tracked forth and back must return within this distance.",
    )


class MotionParameters(Stage):
    """Planar models: from two positions of a dynamic feature to a velocity."""

    models = PLANAR

    max_speed_mps: Real = number(
        40.0,
        ge=0.1,
        le=100.0,
        unit="m/s",
        step=0.1,
        title="Highest speed",
        help="Faster displacements are taken for stereo errors and left out.",
    )
    disparity_sigma_px: Real = number(
        0.2,
        ge=0.05,
        le=3.0,
        unit="px",
        step=0.05,
        title="Disparity noise",
        help="One standard deviation of a measured disparity; sets the stated uncertainty.",
    )
    pixel_sigma_px: Real = number(
        0.3,
        ge=0.05,
        le=3.0,
        unit="px",
        step=0.05,
        title="Flow noise",
        help="One standard deviation of a tracked position; sets the stated uncertainty.",
    )
    noise_correlation: Real = number(
        0.15,
        ge=0.0,
        le=1.0,
        unit="",
        step=0.05,
        title="Shared error",
        help="Share of the noise that neighbouring points have in common and that averaging "
        "cannot reduce; sets the stated uncertainty.",
    )
    turn_sigma_radps: Real = number(
        0.4,
        ge=0.0,
        le=5.0,
        unit="rad/s",
        step=0.1,
        title="Unseen turning",
        help="One standard deviation of how fast an obstacle turns: the side that is seen then "
        "moves otherwise than the centre; sets the stated uncertainty.",
    )
    min_significance: Real = number(
        3.0,
        ge=0.0,
        le=20.0,
        unit="standard deviations",
        step=0.5,
        title="Significance",
        help="Obstacles whose velocity stands out less than this against all known errors, "
        "parallax among them, are left out; 0 keeps all, as the paper does.",
    )


class ClusteringParameters(Stage):
    """Planar models: dynamic points that belong together."""

    models = PLANAR

    radius_m: Real = number(
        0.3,
        ge=0.02,
        le=5.0,
        unit="m",
        step=0.01,
        title="Neighbour radius",
        help="Dynamic points nearer than this, after allowing for depth noise, are one obstacle.",
    )
    min_points: Whole = number(
        4,
        ge=1,
        le=100,
        unit="points",
        step=1,
        title="Fewest points",
        help="Smaller groups are left out.",
    )


class TrackingParameters(Stage):
    """Planar models: identities over time."""

    models = PLANAR

    gate: Real = number(
        0.6,
        ge=0.05,
        le=10.0,
        unit="m",
        step=0.05,
        title="Gate",
        help="A cluster farther than this from where a track is expected starts a new track.",
    )
    confirm_hits: Whole = number(
        3,
        ge=1,
        le=30,
        unit="frames",
        step=1,
        title="Confirm after",
        help="A track is reported after this many sightings.",
    )
    coast_frames: Whole = number(
        5,
        ge=0,
        le=60,
        unit="frames",
        step=1,
        title="Coast for",
        help="A track that is not seen any more is kept for this many frames.",
    )

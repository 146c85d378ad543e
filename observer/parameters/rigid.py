"""Motion in space: following points, judging which move, obstacles as bodies."""

from __future__ import annotations

from observer.parameters.fields import KLT, Real, Stage, Whole, number


class KltTrackingParameters(Stage):
    """Following points from frame to frame, in both cameras or in one."""

    models = KLT

    spacing_px: Whole = number(
        18,
        ge=6,
        le=64,
        unit="px",
        step=1,
        title="Spacing",
        help="One point is followed in each square of this side.",
    )
    window_px: Whole = number(
        13,
        ge=5,
        le=51,
        unit="px",
        step=2,
        title="Window",
        help="Side of the Lucas-Kanade window.",
    )
    min_texture: Real = number(
        1.6,
        ge=0.0,
        le=20.0,
        unit="grey levels/px",
        step=0.1,
        title="Least texture",
        help="Points whose surroundings vary less than this in any one direction are left out.",
    )
    max_error: Real = number(
        20.0,
        ge=1.0,
        le=100.0,
        unit="grey levels",
        step=1.0,
        title="Largest match error",
        help="Points whose surroundings differ more than this on average are left out.",
    )
    back_check_px: Real = number(
        0.5,
        ge=0.05,
        le=10.0,
        unit="px",
        step=0.05,
        title="Backward check",
        help="A point followed forth and back must return within this distance.",
    )
    circle_px: Real = number(
        1.0,
        ge=0.05,
        le=10.0,
        unit="px",
        step=0.05,
        title="Circle check",
        help="The two ways from the left image at t to the right one at t+dt must meet.",
    )
    row_px: Real = number(
        3.0,
        ge=0.5,
        le=20.0,
        unit="px",
        step=0.5,
        title="Row tolerance",
        help="How far a match in the right image may lie off the row.",
    )
    noise_factor: Real = number(
        1.5,
        ge=0.1,
        le=10.0,
        unit="",
        step=0.1,
        title="Noise factor",
        help="The noise of a followed position, relative to what texture and grey levels promise.",
    )
    noise_floor_px: Real = number(
        0.06,
        ge=0.0,
        le=3.0,
        unit="px",
        step=0.01,
        title="Noise floor",
        help="Noise of a followed position that does not depend on texture.",
    )
    scale_change_noise: Real = number(
        0.3,
        ge=0.0,
        le=2.0,
        unit="",
        step=0.05,
        title="Growth noise",
        help="Noise of a followed position by the growing or shrinking of its surroundings, as a "
        "share of how far they grow.",
    )
    skew_sigma_s: Real = number(
        0.001,
        ge=0.0,
        le=0.1,
        unit="s",
        step=0.0005,
        title="Skew noise",
        help="One standard deviation of the time between the exposures of free-running cameras.",
    )


class EvidenceParameters(Stage):
    """Which followed points move."""

    models = KLT

    memory_s: Real = number(
        0.5,
        ge=0.05,
        le=10.0,
        unit="s",
        step=0.05,
        title="Memory",
        help="How long sightings of a point count.",
    )
    radius_px: Real = number(
        26.0,
        ge=4.0,
        le=200.0,
        unit="px",
        step=1.0,
        title="Neighbourhood",
        help="Points nearer than this, in the image and alike in depth, are judged together.",
    )
    false_alarms_per_frame: Real = number(
        0.001,
        ge=1e-9,
        le=1.0,
        unit="",
        step=1e-9,
        title="False alarms",
        help="Declared rate of false alarms per frame over all points.",
    )
    noise_correlation: Real = number(
        0.1,
        ge=0.0,
        le=1.0,
        unit="",
        step=0.05,
        title="Shared error",
        help="Share of the noise that neighbouring points have in common.",
    )
    disparity_bias_px: Real = number(
        0.1,
        ge=0.0,
        le=5.0,
        unit="px",
        step=0.05,
        title="Disparity bias",
        help="One standard deviation of the error of a disparity that lasts from frame to frame, "
        "by calibration or by what is beside the point; it makes what is far from a fast camera "
        "seem to move.",
        models=("rigid",),
    )
    distortion_sigma: Real = number(
        0.05,
        ge=0.0,
        le=1.0,
        unit="",
        step=0.01,
        title="Stretch",
        help="One standard deviation of the share by which distortion that was not calibrated "
        "stretches the image in its corners; it falls towards the centre. It makes what passes "
        "by at the edge of the view seem to move.",
        models=("rigid",),
    )
    least_noise: Real = number(
        1.0,
        ge=0.1,
        le=10.0,
        unit="",
        step=0.1,
        title="Least noise",
        help="The noise of the sightings is learnt from the background; it is taken for no less "
        "than this share of what texture and grey levels promise.",
    )
    min_sightings: Whole = number(
        3,
        ge=2,
        le=30,
        unit="frames",
        step=1,
        title="Fewest sightings",
        help="Points seen in fewer frames are not judged.",
    )
    min_points: Whole = number(
        3,
        ge=1,
        le=50,
        unit="points",
        step=1,
        title="Fewest points",
        help="Fewer neighbours that move alike are no evidence.",
    )


class ObstacleParameters(Stage):
    """Obstacles as bodies over time."""

    models = KLT

    acceleration_px: Real = number(
        200.0,
        ge=1.0,
        le=5000.0,
        unit="px/s^2",
        step=10.0,
        title="Acceleration",
        help="One standard deviation of how strongly a manoeuvring obstacle accelerates.",
    )
    noise_correlation: Real = number(
        0.1,
        ge=0.0,
        le=1.0,
        unit="",
        step=0.05,
        title="Shared error",
        help="Share of the noise that the points of an obstacle have in common.",
    )
    min_points: Whole = number(
        3,
        ge=1,
        le=50,
        unit="points",
        step=1,
        title="Fewest points",
        help="An obstacle seen by fewer points is not seen.",
    )
    margin: Real = number(
        0.15,
        ge=0.0,
        le=2.0,
        unit="",
        step=0.05,
        title="Margin",
        help="Points join an obstacle up to this share of its size outside its box.",
    )
    confirm_sigmas: Real = number(
        5.0,
        ge=0.5,
        le=50.0,
        unit="standard deviations",
        step=0.5,
        title="Confirm above",
        help="How significant its velocity must be.",
    )
    confirm_hits: Whole = number(
        3,
        ge=1,
        le=30,
        unit="frames",
        step=1,
        title="Confirm after",
        help="For how many frames.",
    )
    coast_s: Real = number(
        2.0,
        ge=0.0,
        le=10.0,
        unit="s",
        step=0.1,
        title="Coast for",
        help="An obstacle that is not seen any more is kept for this long.",
    )
    stopped_below_mps: Real = number(
        0.06,
        ge=0.0,
        le=5.0,
        unit="m/s",
        step=0.01,
        title="Stopped below",
        help="An obstacle slower than this counts as stopped.",
    )

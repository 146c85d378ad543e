"""Motion in space: tracking points, testing which move, obstacles as bodies."""

from __future__ import annotations

from observer.parameters.fields import KLT, RIGID, Real, Stage, Whole, number


class KltTrackingParameters(Stage):
    """KLT tracking of points from frame to frame, in both cameras or in one."""

    models = KLT

    spacing_px: Whole = number(
        18,
        ge=6,
        le=64,
        unit="px",
        step=1,
        title="Spacing",
        help="One point is tracked in each square of this side.",
    )
    window_px: Whole = number(
        13,
        ge=5,
        le=51,
        unit="px",
        step=2,
        title="Window size",
        help="Side of the Lucas-Kanade window.",
    )
    min_texture: Real = number(
        1.6,
        ge=0.0,
        le=20.0,
        unit="grey levels/px",
        step=0.1,
        title="Min. texture",
        help="Points whose neighbourhood varies less in any one direction are not tracked.",
    )
    max_error: Real = number(
        20.0,
        ge=1.0,
        le=100.0,
        unit="grey levels",
        step=1.0,
        title="Max. match error",
        help="Matches whose neighbourhoods differ more on average are rejected.",
    )
    back_check_px: Real = number(
        0.5,
        ge=0.05,
        le=10.0,
        unit="px",
        step=0.05,
        title="Forward-backward error",
        help="Max. distance from its start at which a point tracked forward and back may end.",
    )
    circle_px: Real = number(
        1.0,
        ge=0.05,
        le=10.0,
        unit="px",
        step=0.05,
        title="Circle check",
        help="Max. distance between the two paths from the left image at t to the right image at "
        "t+dt.",
        models=RIGID,
    )
    row_px: Real = number(
        3.0,
        ge=0.5,
        le=20.0,
        unit="px",
        step=0.5,
        title="Max. epipolar error",
        help="Max. row offset of a match in the right image.",
        models=RIGID,
    )
    noise_factor: Real = number(
        1.5,
        ge=0.1,
        le=10.0,
        unit="",
        step=0.1,
        title="Noise factor",
        help="Noise of a tracked position, relative to what texture and grey levels predict.",
    )
    noise_floor_px: Real = number(
        0.06,
        ge=0.0,
        le=3.0,
        unit="px",
        step=0.01,
        title="Noise floor",
        help="Noise of a tracked position that does not depend on texture.",
    )
    scale_change_noise: Real = number(
        0.3,
        ge=0.0,
        le=2.0,
        unit="",
        step=0.05,
        title="Scale change noise",
        help="Noise of a tracked position due to the scale change of its neighbourhood, relative "
        "to that change.",
        models=RIGID,
    )
    skew_sigma_s: Real = number(
        0.001,
        ge=0.0,
        le=0.1,
        unit="s",
        step=0.0005,
        title="Exposure skew noise",
        help="Standard deviation of the time between the exposures of unsynchronized cameras.",
        models=RIGID,
    )


class EvidenceParameters(Stage):
    """The test which of the tracked points move."""

    models = KLT

    memory_s: Real = number(
        0.5,
        ge=0.05,
        le=10.0,
        unit="s",
        step=0.05,
        title="Memory",
        help="Time constant with which earlier sightings of a point are forgotten.",
        models=RIGID,
    )
    radius_px: Real = number(
        26.0,
        ge=4.0,
        le=200.0,
        unit="px",
        step=1.0,
        title="Neighbourhood",
        help="Points within this radius and at similar depth are tested together.",
    )
    false_alarms_per_frame: Real = number(
        0.001,
        ge=1e-9,
        le=1.0,
        unit="",
        step=1e-9,
        title="False alarm rate",
        help="Expected false alarms per frame over all points.",
    )
    noise_correlation: Real = number(
        0.1,
        ge=0.0,
        le=1.0,
        unit="",
        step=0.05,
        title="Noise correlation",
        help="Share of the measurement noise that neighbouring points have in common.",
    )
    disparity_bias_px: Real = number(
        0.1,
        ge=0.0,
        le=5.0,
        unit="px",
        step=0.05,
        title="Disparity bias",
        help="Standard deviation of the disparity error that persists from frame to frame, due to "
        "calibration or the surroundings of a point; it makes distant background seem to move "
        "when the camera is fast.",
        models=RIGID,
    )
    distortion_sigma: Real = number(
        0.05,
        ge=0.0,
        le=1.0,
        unit="",
        step=0.01,
        title="Residual distortion",
        help="Standard deviation of the relative stretch of the image corners by uncalibrated "
        "distortion; it falls off towards the centre. It makes what passes the edge of the view "
        "seem to move.",
        models=RIGID,
    )
    least_noise: Real = number(
        1.0,
        ge=0.1,
        le=10.0,
        unit="",
        step=0.1,
        title="Min. noise",
        help="Lower limit of the noise that is learnt from the background, relative to what "
        "texture and grey levels predict.",
        models=RIGID,
    )
    min_sightings: Whole = number(
        3,
        ge=2,
        le=30,
        unit="frames",
        step=1,
        title="Min. sightings",
        help="Points seen in fewer frames are not tested.",
    )
    min_points: Whole = number(
        3,
        ge=1,
        le=50,
        unit="points",
        step=1,
        title="Min. points",
        help="Fewer neighbours that move alike are no evidence of motion.",
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
        help="Standard deviation of a manoeuvring obstacle's acceleration, in the image.",
        models=RIGID,
    )
    noise_correlation: Real = number(
        0.1,
        ge=0.0,
        le=1.0,
        unit="",
        step=0.05,
        title="Noise correlation",
        help="Share of the measurement noise that the points of an obstacle have in common.",
        models=RIGID,
    )
    min_points: Whole = number(
        3,
        ge=1,
        le=50,
        unit="points",
        step=1,
        title="Min. points",
        help="An obstacle with fewer visible points counts as not seen.",
    )
    margin: Real = number(
        0.15,
        ge=0.0,
        le=2.0,
        unit="",
        step=0.05,
        title="Margin",
        help="Distance outside an obstacle's box within which points join it, relative to its "
        "size.",
        models=RIGID,
    )
    confirm_sigmas: Real = number(
        5.0,
        ge=0.5,
        le=50.0,
        unit="standard deviations",
        step=0.5,
        title="Confirmation threshold",
        help="Min. significance of an obstacle's velocity.",
        models=RIGID,
    )
    confirm_hits: Whole = number(
        3,
        ge=1,
        le=30,
        unit="frames",
        step=1,
        title="Confirmation frames",
        help="Number of frames in which the obstacle must be significant.",
    )
    coast_s: Real = number(
        2.0,
        ge=0.0,
        le=10.0,
        unit="s",
        step=0.1,
        title="Coasting time",
        help="Time after which an obstacle that is no longer seen is dropped.",
    )
    stopped_below_mps: Real = number(
        0.06,
        ge=0.0,
        le=5.0,
        unit="m/s",
        step=0.01,
        title="Stopped below",
        help="Slower obstacles count as stopped.",
    )

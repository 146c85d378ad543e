"""Parameters of motion in space: tracking points, testing them for motion, tracking obstacles."""

from __future__ import annotations

from observer.parameters.fields import KLT, RIGID, Real, Stage, Whole, number


class KltTrackingParameters(Stage):
    """KLT tracking of points from frame to frame, in both cameras or in one."""

    models = KLT

    spacing_px: Whole = number(
        18, unit="px", ge=6, le=64, step=1, title="Feature spacing", basic=True
    )
    """One point is tracked in each square of this side."""
    window_px: Whole = number(13, unit="px", ge=5, le=51, step=2, title="KLT window size")
    """Side of the Lucas-Kanade window."""
    min_texture: Real = number(
        1.6, unit="grey levels/px", ge=0.0, le=20.0, step=0.1, title="Min. feature texture"
    )
    """Points whose neighbourhood varies less in any one direction are not tracked."""
    max_error: Real = number(
        20.0, unit="grey levels", ge=1.0, le=100.0, step=1.0, title="Max. KLT match error"
    )
    """Matches whose neighbourhoods differ more on average are rejected."""
    back_check_px: Real = number(
        0.5, unit="px", ge=0.05, le=10.0, step=0.05, title="KLT forward-backward error"
    )
    """Max. distance between a point's start and the place to which it is tracked back."""
    circle_px: Real = number(
        1.0, unit="px", ge=0.05, le=10.0, step=0.05, title="Stereo circle check", models=RIGID
    )
    """Max. distance between the two paths from the left image at t to the right image at t+dt."""
    row_px: Real = number(
        3.0, unit="px", ge=0.5, le=20.0, step=0.5, title="Max. epipolar error", models=RIGID
    )
    """Max. row offset of a match in the right image."""
    noise_factor: Real = number(1.5, ge=0.1, le=10.0, step=0.1, title="KLT noise factor")
    """Noise of a tracked position, relative to what texture and grey levels predict."""
    noise_floor_px: Real = number(
        0.06, unit="px", ge=0.0, le=3.0, step=0.01, title="KLT noise floor"
    )
    """Noise of a tracked position that does not depend on texture."""
    scale_change_noise: Real = number(
        0.3, ge=0.0, le=2.0, step=0.05, title="Scale change noise", models=RIGID
    )
    """Noise of a tracked position due to the scale change of its neighbourhood, relative to that
    change."""
    skew_sigma_s: Real = number(
        0.001, unit="s", ge=0.0, le=0.1, step=0.0005, title="Camera sync error", models=RIGID
    )
    """Standard deviation of the time between the exposures of unsynchronized cameras."""


class DenseParameters(Stage):
    """Dense depth besides tracked points: it captures whole bodies, even in plain clothes."""

    models = RIGID

    rate_hz: Real = number(
        60.0, unit="Hz", ge=0.0, le=120.0, step=1.0, title="Dense depth rate", basic=True
    )
    """Maximum rate of dense depth. 0 turns it off: only tracked points are used, and regions in
    which motion cannot be detected are not reported."""


class EvidenceParameters(Stage):
    """Motion test of the tracked points."""

    models = KLT

    memory_s: Real = number(
        0.5, unit="s", ge=0.05, le=10.0, step=0.05, title="Motion test memory", models=RIGID
    )
    """Time constant with which earlier sightings of a point are forgotten."""
    radius_px: Real = number(
        26.0, unit="px", ge=4.0, le=200.0, step=1.0, title="Motion test radius"
    )
    """Points within this radius and at similar depth are tested together."""
    false_alarms_per_frame: Real = number(
        0.001, ge=1e-9, le=1.0, step=1e-9, title="False alarm rate", basic=True
    )
    """Expected false alarms per frame over all points. It sets the threshold of the motion test, as
    flow.residual_threshold_px does with the planar methods: a lower rate is stricter."""
    noise_correlation: Real = number(
        0.1, ge=0.0, le=1.0, step=0.05, title="Motion test noise correlation"
    )
    """Share of the measurement noise that neighbouring points have in common."""
    disparity_bias_px: Real = number(
        0.1, unit="px", ge=0.0, le=5.0, step=0.05, title="Disparity bias", models=RIGID
    )
    """Standard deviation of the disparity error that persists from frame to frame, due to
    calibration or the surroundings of a point; it makes distant background seem to move when the
    camera is fast."""
    distortion_sigma: Real = number(
        0.05, ge=0.0, le=1.0, step=0.01, title="Residual distortion", models=RIGID
    )
    """Standard deviation of the relative stretch of the image corners by uncalibrated distortion;
    it falls off towards the centre. It makes static objects near the edge of the view appear to
    move."""
    least_noise: Real = number(
        1.0, ge=0.1, le=10.0, step=0.1, title="Min. measurement noise", models=RIGID
    )
    """Lower limit of the noise that is learnt from the background, relative to what texture and
    grey levels predict."""
    min_sightings: Whole = number(
        3, unit="frames", ge=2, le=30, step=1, title="Min. sightings of a point"
    )
    """Points seen in fewer frames are not tested."""
    min_points: Whole = number(
        3, unit="points", ge=1, le=50, step=1, title="Min. points moving alike"
    )
    """Fewer neighbours moving alike are not evidence of motion."""


class ObstacleParameters(Stage):
    """Obstacles tracked as bodies."""

    models = KLT

    acceleration_px: Real = number(
        200.0,
        unit="px/s^2",
        ge=1.0,
        le=5000.0,
        step=10.0,
        title="Obstacle image acceleration",
        models=RIGID,
    )
    """Standard deviation of a manoeuvring obstacle's acceleration, in the image."""
    noise_correlation: Real = number(
        0.1, ge=0.0, le=1.0, step=0.05, title="Obstacle noise correlation", models=RIGID
    )
    """Share of the measurement noise that the points of an obstacle have in common."""
    min_points: Whole = number(
        3, unit="points", ge=1, le=50, step=1, title="Min. points per obstacle", basic=True
    )
    """An obstacle with fewer visible points counts as not seen."""
    margin: Real = number(0.15, ge=0.0, le=2.0, step=0.05, title="Obstacle margin", models=RIGID)
    """Distance outside an obstacle's box within which points join it, relative to its size."""
    confirm_sigmas: Real = number(
        5.0,
        unit="standard deviations",
        ge=0.5,
        le=50.0,
        step=0.5,
        title="Obstacle confirmation threshold",
        models=RIGID,
        basic=True,
    )
    """Min. significance of an obstacle's velocity."""
    confirm_hits: Whole = number(
        3, unit="frames", ge=1, le=30, step=1, title="Obstacle confirmation frames"
    )
    """Number of frames in which the obstacle must be significant."""
    coast_s: Real = number(2.0, unit="s", ge=0.0, le=10.0, step=0.1, title="Obstacle coasting time")
    """Time after which an obstacle that is no longer seen is dropped."""
    stopped_below_mps: Real = number(
        0.06, unit="m/s", ge=0.0, le=5.0, step=0.01, title="Stopped below"
    )
    """Slower obstacles count as stopped."""

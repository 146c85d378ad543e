"""Depth from one camera, by travel and by the floor."""

from __future__ import annotations

from observer.parameters.fields import Real, Stage, number


class MonocularParameters(Stage):
    """Depth from the left image alone, by travel and by where things touch the floor (one_camera).

    ``klt_tracking.*`` and ``evidence.false_alarms_per_frame`` act here, too.
    """

    models = ("monocular",)

    height_m: Real = number(
        0.0,
        ge=0.0,
        le=100.0,
        unit="m",
        step=0.01,
        title="Height",
        help="Of the camera above the floor; 0 takes height and tilt as the source's rig tells "
        "them.",
    )
    tilt_deg: Real = number(
        0.0,
        ge=-60.0,
        le=60.0,
        unit="deg",
        step=0.5,
        title="Tilt",
        help="How far the camera looks down; counts where monocular.height_m is given.",
    )
    height_sigma: Real = number(
        0.02,
        ge=0.0,
        le=0.5,
        unit="",
        step=0.005,
        title="Height uncertainty",
        help="One standard deviation of the height, as a share of it; sets the stated uncertainty.",
    )
    tilt_sigma_deg: Real = number(
        0.2,
        ge=0.0,
        le=10.0,
        unit="deg",
        step=0.05,
        title="Tilt uncertainty",
        help="One standard deviation of the tilt; sets the stated uncertainty.",
    )
    odometry_sigma: Real = number(
        0.02,
        ge=0.001,
        le=0.5,
        unit="",
        step=0.005,
        title="Odometry uncertainty",
        help="One standard deviation of driven ways, as a share of them.",
    )
    parallax_deg: Real = number(
        0.6,
        ge=0.1,
        le=10.0,
        unit="deg",
        step=0.1,
        title="Parallax to start",
        help="Without odometry, depth is first told once points have shifted this far by travel "
        "alone.",
    )
    memory_s: Real = number(
        1.0,
        ge=0.2,
        le=10.0,
        unit="s",
        step=0.1,
        title="Memory",
        help="Over how long a point must look as if it stood.",
    )
    farthest_m: Real = number(
        6.0,
        ge=0.5,
        le=100.0,
        unit="m",
        step=0.5,
        title="Farthest floor",
        help="Obstacles that touch the floor farther away than this are left out.",
    )
    foot_sigma_px: Real = number(
        2.0,
        ge=0.2,
        le=20.0,
        unit="px",
        step=0.1,
        title="Foot noise",
        help="One standard deviation of where an obstacle is seen to touch the floor.",
    )
    acceleration: Real = number(
        0.4,
        ge=0.01,
        le=20.0,
        unit="m/s^2",
        step=0.05,
        title="Acceleration",
        help="One standard deviation of how strongly an obstacle accelerates.",
    )
    confirm_sigmas: Real = number(
        4.0,
        ge=0.5,
        le=50.0,
        unit="standard deviations",
        step=0.5,
        title="Confirm above",
        help="How significant its velocity over the floor must be.",
    )

"""Parameters of the monocular method."""

from __future__ import annotations

from observer.parameters.fields import Real, Stage, number


class MonocularParameters(Stage):
    """Depth from the left image only: by parallax and by where obstacles touch the ground."""

    models = ("monocular",)

    height_m: Real = number(
        0.0, unit="m", ge=0.0, le=100.0, step=0.01, title="Camera height", basic=True
    )
    """Height of the camera above the ground; 0 takes height and tilt from the rig of the source."""
    tilt_deg: Real = number(0.0, unit="deg", ge=-60.0, le=60.0, step=0.5, title="Camera tilt")
    """Downward tilt of the camera; used if monocular.height_m is set."""
    height_sigma: Real = number(0.02, ge=0.0, le=0.5, step=0.005, title="Camera height uncertainty")
    """Standard deviation of the camera height, relative to it."""
    tilt_sigma_deg: Real = number(
        0.2, unit="deg", ge=0.0, le=10.0, step=0.05, title="Camera tilt uncertainty"
    )
    """Standard deviation of the camera tilt."""
    odometry_sigma: Real = number(0.02, ge=0.001, le=0.5, step=0.005, title="Odometry uncertainty")
    """Standard deviation of the distance travelled, relative to it."""
    parallax_deg: Real = number(
        0.6, unit="deg", ge=0.1, le=10.0, step=0.1, title="Initial parallax"
    )
    """Depth is initialized once the median parallax exceeds this or the ground shows the travel."""
    memory_s: Real = number(1.0, unit="s", ge=0.2, le=10.0, step=0.1, title="Static point memory")
    """Time over which a point must agree with a static one."""
    farthest_m: Real = number(
        6.0, unit="m", ge=0.5, le=100.0, step=0.5, title="Max. obstacle range", basic=True
    )
    """Obstacles that touch the ground farther away are ignored."""
    foot_sigma_px: Real = number(
        2.0, unit="px", ge=0.2, le=20.0, step=0.1, title="Ground contact noise"
    )
    """Standard deviation of the image row in which an obstacle touches the ground."""
    acceleration: Real = number(
        0.4, unit="m/s^2", ge=0.01, le=20.0, step=0.05, title="Obstacle acceleration"
    )
    """Standard deviation of an obstacle's acceleration."""
    confirm_sigmas: Real = number(
        4.0,
        unit="standard deviations",
        ge=0.5,
        le=50.0,
        step=0.5,
        title="Monocular confirmation threshold",
        basic=True,
    )
    """Min. significance of an obstacle's velocity over the ground."""

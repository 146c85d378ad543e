"""Parameters of the guard."""

from __future__ import annotations

from observer.parameters.fields import Real, Stage, number


class GuardParameters(Stage):
    """Speed limits of the robots, from vision and sonar; no observation depends on them."""

    speed_max_mps: Real = number(
        0.5, unit="m/s", ge=0.05, le=2.0, step=0.05, title="Max. robot speed"
    )
    """Upper limit for both robots, whoever drives."""
    turn_rate_max_radps: Real = number(
        1.0, unit="rad/s", ge=0.1, le=5.0, step=0.1, title="Max. robot turn rate"
    )
    """Upper limit for both robots, whoever drives."""
    acceleration_mps2: Real = number(
        0.3, unit="m/s^2", ge=0.05, le=3.0, step=0.05, title="Robot acceleration"
    )
    """Limit on how fast the speed rises; braking is not limited."""
    turn_acceleration_radps2: Real = number(
        1.5, unit="rad/s^2", ge=0.1, le=10.0, step=0.1, title="Robot turn acceleration"
    )
    """Limit on how fast the turn rate rises, and the rate at which it is assumed to fall."""
    deceleration_mps2: Real = number(
        0.5, unit="m/s^2", ge=0.05, le=5.0, step=0.05, title="Braking deceleration"
    )
    """Deceleration that is assumed; measure that of your robot."""
    reaction_s: Real = number(
        0.3, unit="s", ge=0.05, le=2.0, step=0.05, title="Robot reaction time"
    )
    """Time from an event in front of the cameras until the robot starts to brake."""
    margin_m: Real = number(0.08, unit="m", ge=0.0, le=1.0, step=0.01, title="Guard margin")
    """Clearance to every obstacle at which the robot must have stopped."""
    sigmas: Real = number(
        2.0, unit="standard deviations", ge=0.0, le=5.0, step=0.5, title="Guard uncertainty factor"
    )
    """Standard deviations of the measurements that are added to every distance."""
    slow_time_s: Real = number(2.0, unit="s", ge=0.1, le=10.0, step=0.1, title="Slow-down time")
    """A shorter time to contact slows the robot down in proportion."""
    creep_mps: Real = number(0.03, unit="m/s", ge=0.0, le=0.5, step=0.01, title="Min. robot speed")
    """If only a lower speed is permitted, the robot stops."""
    release_s: Real = number(0.4, unit="s", ge=0.0, le=5.0, step=0.1, title="Guard release time")
    """A limit is relaxed only after a looser one has sufficed for this long, to keep the speed from
    oscillating."""
    robot_height_m: Real = number(0.5, unit="m", ge=0.05, le=3.0, step=0.05, title="Robot height")
    """Objects higher above the ground than this can be passed under."""
    step_m: Real = number(0.06, unit="m", ge=0.01, le=0.5, step=0.01, title="Min. obstacle height")
    """Objects lower than this count as ground."""
    intruder_mps: Real = number(0.5, unit="m/s", ge=0.0, le=3.0, step=0.1, title="Intruder speed")
    """Speed at which something unseen may enter ground that was seen free and is out of view."""
    memory_s: Real = number(1.0, unit="s", ge=0.0, le=30.0, step=0.1, title="Free ground memory")
    """How long ground that was seen to be free still counts as free, unless something unseen could
    have entered it."""
    sonar_stop_m: Real = number(
        0.2, unit="m", ge=0.0, le=2.0, step=0.05, title="Sonar stop distance"
    )
    """An echo closer than this ahead of the robot stops it, whatever the cameras see."""
    sonar_reach_m: Real = number(2.0, unit="m", ge=0.1, le=6.0, step=0.1, title="Sonar range")
    """Without an echo, the cone of a sonar counts as free up to this range."""
    sonar_half_angle_deg: Real = number(
        15.0, unit="deg", ge=2.0, le=60.0, step=1.0, title="Sonar half angle"
    )
    """Half the angle of a sonar's cone of detection."""
    sonar_fresh_s: Real = number(0.6, unit="s", ge=0.05, le=5.0, step=0.05, title="Sonar timeout")
    """Time for which a reading counts; the sonars of a ring are read in turn."""
    thing_width_m: Real = number(
        0.35, unit="m", ge=0.0, le=1.0, step=0.05, title="Min. obstacle width"
    )
    """Narrower objects between the cones of two sonars may go undetected."""


# Parameters that only limit the robots more when they fall, and when they rise. Those of a sonar's
# cone and of the age of its readings do either, depending on the place.
_STRICTER_IF_LOWER = (
    *("speed_max_mps", "turn_rate_max_radps", "acceleration_mps2", "turn_acceleration_radps2"),
    *("deceleration_mps2", "step_m", "memory_s", "sonar_reach_m", "thing_width_m"),
)
_STRICTER_IF_HIGHER = (
    *("reaction_s", "margin_m", "sigmas", "slow_time_s", "creep_mps", "release_s"),
    *("robot_height_m", "intruder_mps", "sonar_stop_m"),
)


def is_loosened(before: GuardParameters, after: GuardParameters) -> bool:
    """Return whether the guard may permit more after a change of its parameters."""
    return any(
        (name not in _STRICTER_IF_LOWER or value > getattr(before, name))
        and (name not in _STRICTER_IF_HIGHER or value < getattr(before, name))
        for name, value in after
        if value != getattr(before, name)
    )

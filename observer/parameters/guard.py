"""How the robots' speed is limited: the guard's parameters, in the drive process."""

from __future__ import annotations

from observer.parameters.fields import Real, Stage, number


class GuardParameters(Stage):
    """How fast the robots may drive, by what is seen and by sonar; no observation depends on it."""

    speed_max_mps: Real = number(
        0.5,
        ge=0.05,
        le=2.0,
        unit="m/s",
        step=0.05,
        title="Highest speed",
        help="Neither robot is driven faster, whoever asks.",
    )
    turn_rate_max_radps: Real = number(
        1.0,
        ge=0.1,
        le=5.0,
        unit="rad/s",
        step=0.1,
        title="Highest turn rate",
        help="Neither robot is turned faster, whoever asks.",
    )
    acceleration_mps2: Real = number(
        0.3,
        ge=0.05,
        le=3.0,
        unit="m/s^2",
        step=0.05,
        title="Acceleration",
        help="How quickly speed rises; braking is not held back.",
    )
    turn_acceleration_radps2: Real = number(
        1.5,
        ge=0.1,
        le=10.0,
        unit="rad/s^2",
        step=0.1,
        title="Turn acceleration",
        help="How quickly the turn rate rises, and what is counted on while it falls.",
    )
    deceleration_mps2: Real = number(
        0.5,
        ge=0.05,
        le=5.0,
        unit="m/s^2",
        step=0.05,
        title="Braking",
        help="The deceleration that is counted on; measure what the robot really does.",
    )
    reaction_s: Real = number(
        0.3,
        ge=0.05,
        le=2.0,
        unit="s",
        step=0.05,
        title="Reaction time",
        help="From what happens before the cameras to where the robot begins to brake.",
    )
    margin_m: Real = number(
        0.08,
        ge=0.0,
        le=1.0,
        unit="m",
        step=0.01,
        title="Margin",
        help="Distance that is kept from everything when the robot stands again.",
    )
    sigmas: Real = number(
        2.0,
        ge=0.0,
        le=5.0,
        unit="standard deviations",
        step=0.5,
        title="Uncertainty kept off",
        help="How many standard deviations of what is measured are added to every distance.",
    )
    slow_time_s: Real = number(
        2.0,
        ge=0.1,
        le=10.0,
        unit="s",
        step=0.1,
        title="Slow within",
        help="What would be met sooner than this makes the robot slow down in proportion.",
    )
    creep_mps: Real = number(
        0.03,
        ge=0.0,
        le=0.5,
        unit="m/s",
        step=0.01,
        title="Slowest speed",
        help="Where less than this would be permitted, the robot stands.",
    )
    release_s: Real = number(
        0.4,
        ge=0.0,
        le=5.0,
        unit="s",
        step=0.1,
        title="Release after",
        help="A limit is loosened once less is called for during this time, so that the speed "
        "does not jump to and fro.",
    )
    robot_height_m: Real = number(
        0.5,
        ge=0.05,
        le=3.0,
        unit="m",
        step=0.05,
        title="Robot height",
        help="What hangs higher than this above the floor is passed under.",
    )
    step_m: Real = number(
        0.06,
        ge=0.01,
        le=0.5,
        unit="m",
        step=0.01,
        title="Lowest obstacle",
        help="What rises less than this above the floor counts as floor.",
    )
    intruder_mps: Real = number(
        0.5,
        ge=0.0,
        le=3.0,
        unit="m/s",
        step=0.1,
        title="Unseen speed",
        help="How fast something unseen may come into ground that was seen free a moment ago and "
        "is not in view any more.",
    )
    memory_s: Real = number(
        1.0,
        ge=0.0,
        le=30.0,
        unit="s",
        step=0.1,
        title="Memory of free ground",
        help="For how long ground that was seen free counts, as far as nothing unseen can have "
        "come in.",
    )
    sonar_stop_m: Real = number(
        0.2,
        ge=0.0,
        le=2.0,
        unit="m",
        step=0.05,
        title="Sonar stop distance",
        help="An echo this near ahead of the robot stops it, whatever is seen.",
    )
    sonar_reach_m: Real = number(
        2.0,
        ge=0.1,
        le=6.0,
        unit="m",
        step=0.1,
        title="Sonar reach",
        help="A sonar without an echo tells that its cone is clear up to here.",
    )
    sonar_half_angle_deg: Real = number(
        15.0,
        ge=2.0,
        le=60.0,
        unit="deg",
        step=1.0,
        title="Sonar half angle",
        help="Half the angle of the cone in which a sonar notices things.",
    )
    sonar_fresh_s: Real = number(
        0.6,
        ge=0.05,
        le=5.0,
        unit="s",
        step=0.05,
        title="Sonar keeps for",
        help="A sonar's reading counts for this long; each sonar of a ring is asked in turn.",
    )
    thing_width_m: Real = number(
        0.35,
        ge=0.0,
        le=1.0,
        unit="m",
        step=0.05,
        title="Narrowest thing",
        help="Between two sonars' cones nothing narrower than this is counted on being noticed.",
    )

"""Parameters of the planner, and the full set for observing and driving."""

from __future__ import annotations

import math

from observer.guard.parameters import GuardParameters
from observer.parameters import Parameters
from observer.parameters.fields import Real, Stage, number


class NavigationParameters(Stage):
    """Path to a goal among moving obstacles; neither observations nor the guard depend on it."""

    risk_per_metre: Real = number(
        0.001, unit="1/m", ge=1e-6, le=1.0, step=1e-6, title="Risk per metre"
    )
    """Accepted probability of a contact with tracked obstacles per metre driven, for goals sent
    without their own."""
    detour_m: Real = number(3.0, unit="m", ge=0.0, le=20.0, step=0.1, title="Max. detour")
    """Extra path length accepted to avoid a certain contact; less for improbable or later ones."""
    berth_m: Real = number(0.2, unit="m", ge=0.0, le=2.0, step=0.05, title="Path clearance")
    """Clearance to moving obstacles that a path should keep beyond the guard's margin."""
    near_m: Real = number(0.8, unit="m", ge=0.0, le=3.0, step=0.05, title="Proximity distance")
    """Clearance to moving obstacles below which driving has a proximity cost."""
    near_cost_mps: Real = number(0.4, unit="m/s", ge=0.0, le=5.0, step=0.05, title="Proximity cost")
    """Cost, as path length, of each second within the proximity distance at full speed."""
    foresight_s: Real = number(
        1.5, unit="s", ge=0.1, le=10.0, step=0.1, title="Contact discount time"
    )
    """Time constant for discounting predicted contacts: later plans can still avoid them."""
    refused_m: Real = number(1.0, unit="m", ge=0.0, le=10.0, step=0.1, title="Guard slow-down cost")
    """Cost, as path length, of a velocity that the guard would reduce to zero; proportional."""
    memory_s: Real = number(2.5, unit="s", ge=0.0, le=30.0, step=0.1, title="Track memory")
    """Time for which an obstacle that is out of view is predicted from its last velocity."""
    acceleration_noise: Real = number(
        0.55, unit="m/s^2/sqrt(Hz)", ge=0.0, le=5.0, step=0.05, title="Predicted acceleration noise"
    )
    """Spectral density of the random acceleration that widens the predictions."""
    stop_probability: Real = number(
        0.08, ge=0.0, le=0.5, step=0.01, title="Obstacle stop probability"
    )
    """Prior probability that a moving obstacle comes to a stop."""
    turn_probability: Real = number(
        0.1, ge=0.0, le=0.45, step=0.01, title="Obstacle turn probability"
    )
    """Prior probability that a moving obstacle turns, half of it to either side."""

    @property
    def prior(self) -> tuple[float, float, float, float]:
        """Probabilities of going on (0.05 or more), stopping, turning left and right.

        They apply to a person of whom nothing is known.
        """
        turn = self.turn_probability
        # fsum rounds only once, as if the value had been written out.
        goes_on = math.fsum((1.0, -self.stop_probability, -turn))
        return goes_on, self.stop_probability, turn / 2, turn / 2


class AllParameters(Parameters):
    """The parameters of the methods, the guard and the planner."""

    guard: GuardParameters = GuardParameters()
    navigation: NavigationParameters = NavigationParameters()

    @property
    def vision(self) -> Parameters:
        """The observer's parameters; they stay equal when other groups change."""
        return Parameters.model_validate(
            {group: getattr(self, group) for group in Parameters.model_fields}
        )

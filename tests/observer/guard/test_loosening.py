"""Which changes of the guard's parameters may permit more."""

from __future__ import annotations

import pytest

from observer.guard.parameters import GuardParameters, is_loosened

P = GuardParameters()
LOOSER_IF_HIGHER = {
    "speed_max_mps", "turn_rate_max_radps", "acceleration_mps2", "turn_acceleration_radps2",
    "deceleration_mps2", "step_m", "memory_s", "sonar_reach_m", "thing_width_m",
}  # fmt: skip
LOOSER_IF_LOWER = {
    "reaction_s", "margin_m", "sigmas", "slow_time_s", "creep_mps", "release_s", "robot_height_m",
    "intruder_mps", "sonar_stop_m",
}  # fmt: skip


@pytest.mark.parametrize("name", GuardParameters.model_fields)
def test_every_change_that_may_permit_more_loosens(name: str) -> None:
    value = getattr(P, name)
    higher, lower = (
        is_loosened(P, P.model_copy(update={name: value * factor})) for factor in (1.1, 0.9)
    )
    # Either direction of what is in neither list, also of a new parameter, counts as loosening.
    assert higher == (name not in LOOSER_IF_LOWER)
    assert lower == (name not in LOOSER_IF_HIGHER)


def test_one_looser_value_among_stricter_ones_loosens() -> None:
    changed = {"margin_m": 0.5, "speed_max_mps": 0.1, "reaction_s": 0.1}
    assert is_loosened(P, P.model_copy(update=changed))
    assert not is_loosened(P, P)

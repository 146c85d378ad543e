"""Damaged programmes: either one that robots may drive or a one-sentence error."""

from __future__ import annotations

import math

from hypothesis import given

from observer.errors import InputError
from observer.motion_profiles.library import library_text, profile_names
from observer.motion_profiles.profile import MAX_SPEED_MPS
from observer.motion_profiles.profile_file import profile_from_text, profile_text

from ...damage import damaged_text, examples, hostile_text, read_or_refused

FILES = tuple(library_text(name) for name in profile_names())
WORDS = (
    "name: a\n",
    "steps:\n",
    "  observer:\n",
    "    - {seconds: 1}\n",
    "ramp: true",
    "speed_mps: ",
)


@examples(60)
@given(damaged_text(FILES, WORDS) | hostile_text(WORDS))
def test_a_damaged_programme_is_refused_or_valid(text: str) -> None:
    made = read_or_refused(lambda: profile_from_text(text, "mine"), InputError)
    if made is None:
        return
    for steps in made.steps.values():
        for step in steps:
            assert step.seconds > 0
            assert abs(step.speed_mps) <= MAX_SPEED_MPS
            assert math.isfinite(step.seconds + step.turn_rate_radps)
    # Writing and reading it again changes nothing.
    written = profile_text(made)
    assert profile_text(profile_from_text(written)) == written

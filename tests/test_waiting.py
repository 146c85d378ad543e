"""Waiting says what did not come, and is not hurried by hypothesis."""

from __future__ import annotations

import pytest
from hypothesis import settings

from .waiting import until, until_async


def test_the_accepted_answer_is_returned() -> None:
    answers = iter([None, 0, 3, 8])
    assert until(lambda: next(answers), accept=lambda answer: answer == 3) == 3
    assert until(lambda: next(answers)) == 8


def test_a_failure_says_what_was_awaited_and_what_came_last() -> None:
    with pytest.raises(AssertionError, match=r"not within 0.02 s: the robot; .* was \[\]"):
        until(list, "the robot", 0.02)
    with pytest.raises(AssertionError, match=r"until\(lambda: 0, within_s=0.02\).* was 0"):
        until(lambda: 0, within_s=0.02)


async def test_it_also_waits_in_an_event_loop() -> None:
    answers = iter([0, 5])
    assert await until_async(lambda: next(answers)) == 5
    with pytest.raises(AssertionError, match="the reply; the last answer was None"):
        await until_async(lambda: None, "the reply", 0.02)


def test_an_example_has_no_time_limit_of_its_own() -> None:
    """Hypothesis allows 0.2 s, which any example may take on a busy machine."""
    assert settings().deadline is None

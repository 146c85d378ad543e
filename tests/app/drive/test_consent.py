"""Consent: what counts, for how long, and what it takes to be given again."""

from __future__ import annotations

import math

import pytest

from app.drive.consent import ZERO, Consent
from app.runtime.errors import ProcessRefused

AHEAD = (0.3, 0.0)


def test_a_command_is_valid_for_a_quarter_second_after_it_was_issued() -> None:
    consent = Consent()
    assert consent.take(1, issued=10.0, velocity=AHEAD, now=10.1) == pytest.approx(0.1)
    assert not consent.expire(10.249)
    assert (consent.velocity, consent.present) == (AHEAD, True)
    assert consent.expire(10.25)
    assert (consent.velocity, consent.present, consent.released) == (ZERO, False, False)
    assert not consent.expire(10.3), "it expires once"


@pytest.mark.parametrize("age", [0.25, 0.3, 5.0])
def test_a_command_too_old_on_arrival_is_refused(age: float) -> None:
    consent = Consent()
    with pytest.raises(ProcessRefused, match=f"{1000 * age:.0f} ms old") as refused:
        consent.take(1, 10.0, AHEAD, 10.0 + age)
    assert refused.value.refusal == "state"
    assert (consent.velocity, consent.present) == (ZERO, False)
    consent.take(1, 20.0, AHEAD, 20.0)


@pytest.mark.parametrize("sequence", [-1, 6, 7])
def test_a_replayed_or_overtaken_command_is_refused(sequence: int) -> None:
    consent = Consent()
    consent.take(7, 10.0, AHEAD, 10.0)
    with pytest.raises(ProcessRefused, match="greater than the last one, 7"):
        consent.take(sequence, 10.1, (0.9, 0.0), 10.1)
    assert consent.velocity == AHEAD
    assert consent.expire(10.25), "and prolongs nothing"


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_non_finite_values_are_refused(bad: float) -> None:
    consent = Consent()
    for issued, velocity in ((bad, AHEAD), (10.0, (bad, 0.0)), (10.0, (0.0, bad))):
        with pytest.raises(ProcessRefused, match="finite") as refused:
            consent.take(1, issued, velocity, 10.0)
        assert refused.value.refusal == "input"
    assert consent.velocity == ZERO


def test_a_command_from_the_future_expires_no_later() -> None:
    consent = Consent()
    consent.take(1, issued=99.0, velocity=AHEAD, now=10.0)
    assert consent.expire(10.25)


def test_presence_extends_consent_but_not_velocity() -> None:
    consent = Consent()
    consent.take(1, 10.0, AHEAD, 10.0)
    consent.take(2, 10.2, None, 10.2)
    assert not consent.expire(10.24)
    assert consent.expire(10.26), "the held key is gone"
    assert consent.present
    assert consent.velocity == ZERO


def test_after_expiry_a_held_key_moves_nothing_until_released() -> None:
    consent = Consent()
    consent.take(1, 10.0, AHEAD, 10.0)
    consent.expire(10.4)
    for number in range(20):
        now = 10.5 + 0.1 * number
        consent.take(2 + number, now, AHEAD, now)
        consent.expire(now)
        assert not consent.released
    consent.take(30, 12.5, ZERO, 12.5)
    assert consent.released
    consent.take(31, 12.6, AHEAD, 12.6)
    assert consent.released


def test_a_quarter_second_of_presence_alone_counts_as_release() -> None:
    consent = Consent()
    consent.take(1, 10.0, None, 10.0)
    consent.expire(10.5)
    assert not consent.released
    for now in (10.6, 10.7, 10.8):
        consent.take(int(now * 10), now, None, now)
        assert not consent.released
    consent.take(200, 10.9, None, 10.9)
    assert consent.released


def test_presence_alongside_a_held_key_is_not_a_release() -> None:
    consent = Consent()
    consent.take(1, 10.0, AHEAD, 10.0)
    consent.expire(10.5)
    for number in range(20):
        now = 10.6 + 0.1 * number
        consent.take(2 + 2 * number, now, None, now)
        consent.take(3 + 2 * number, now + 0.05, AHEAD, now + 0.05)
        consent.expire(now + 0.05)
        assert not consent.released


def test_arming_requires_release_only_of_a_held_key() -> None:
    consent = Consent()
    consent.withdraw()
    consent.arm()
    assert consent.released
    consent.take(1, 10.0, AHEAD, 10.0)
    consent.arm()
    assert not consent.released


@pytest.mark.parametrize("interruption", ["withdrawn", "expired"])
def test_arming_after_an_interruption_requires_release_of_a_key_held_before(
    interruption: str,
) -> None:
    consent = Consent()
    consent.take(1, 10.0, AHEAD, 10.0)
    if interruption == "withdrawn":
        consent.withdraw()
    else:
        consent.expire(10.4)
    # Between two commands of a held key, or before its link has recovered.
    consent.arm()
    consent.take(2, 10.5, AHEAD, 10.5)
    assert not consent.released
    consent.take(3, 10.6, ZERO, 10.6)
    assert consent.released


def test_arming_after_an_interruption_requires_nothing_of_who_let_go_meanwhile() -> None:
    consent = Consent()
    consent.take(1, 10.0, AHEAD, 10.0)
    consent.withdraw()
    consent.take(2, 10.1, ZERO, 10.1)
    consent.withdraw()
    consent.arm()
    assert consent.released
    consent.take(3, 10.2, AHEAD, 10.2)
    consent.withdraw()
    for number in range(4):
        consent.take(4 + number, 10.3 + 0.1 * number, None, 10.3 + 0.1 * number)
    consent.withdraw()
    consent.arm()
    assert consent.released

"""Programmes as text: what is accepted, what is refused and how, and that nothing is lost."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.errors import InputError
from observer.motion_profiles.profile import (
    MAX_SPEED_MPS,
    MAX_TURN_RATE_RADPS,
    MotionProfile,
    Step,
)
from observer.motion_profiles.profile_file import MAX_BYTES, profile_from_text, profile_text

MINIMAL = "name: a\nsteps: {obstacle: [{seconds: 1, speed_mps: 0.3}]}\n"


def with_step(step: str) -> str:
    return f"name: a\nsteps: {{obstacle: [{{seconds: 1}}, {step}]}}\n"


def test_a_text_is_read_with_degrees_converted() -> None:
    programme = profile_from_text(
        """
        name: to-and-fro
        title: To and fro
        help: >
          The obstacle drives on,
          and turns.
        gesture: true
        steps:
          obstacle:
            - {seconds: 1.5, speed_mps: -0.25, ramp: true}
            - seconds: 3
              turn_rate_deg: 90
          observer: []
        """
    )
    assert programme == MotionProfile(
        "to-and-fro",
        "To and fro",
        "The obstacle drives on, and turns.",
        {
            "observer": (),
            "obstacle": (Step(1.5, -0.25, 0.0, True), Step(3.0, 0.0, math.pi / 2)),
        },
        True,
    )
    assert programme.roles == ("obstacle",)


def test_a_name_may_come_from_the_file() -> None:
    text = "steps: {observer: [{seconds: 1, speed_mps: 0.1}]}"
    assert profile_from_text(text, "mine").name == "mine"
    assert profile_from_text(MINIMAL, "mine").name == "a"
    with pytest.raises(InputError, match="has no name"):
        profile_from_text(text)


lines = (
    st.text(max_size=60)
    .filter(lambda text: text.isprintable())
    .map(lambda text: " ".join(text.split()))
)
steps = st.builds(
    Step,
    seconds=st.floats(1e-3, 100),
    speed_mps=st.floats(-MAX_SPEED_MPS, MAX_SPEED_MPS),
    turn_rate_radps=st.one_of(
        st.floats(-500, 500).map(math.radians),
        st.integers(-500, 500).map(math.radians),
    ),
    ramp=st.booleans(),
)
programmes = st.builds(
    MotionProfile,
    name=st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_-]{0,20}", fullmatch=True),
    title=lines,
    help=lines,
    steps=st.dictionaries(
        st.sampled_from(["observer", "obstacle"]),
        st.lists(steps, min_size=1, max_size=4).map(tuple),
        min_size=1,
    ),
    gesture=st.booleans(),
)


@given(programmes)
def test_a_written_programme_is_read_back(programme: MotionProfile) -> None:
    text = profile_text(programme)
    read = profile_from_text(text)
    assert (read.name, read.title, read.help, read.gesture) == (
        programme.name, programme.title, programme.help, programme.gesture,
    )  # fmt: skip
    assert read.roles == programme.roles
    for role in programme.roles:
        for mine, theirs in zip(programme.steps[role], read.steps[role], strict=True):
            assert (mine.seconds, mine.speed_mps, mine.ramp) == (
                theirs.seconds, theirs.speed_mps, theirs.ramp,
            )  # fmt: skip
            assert theirs.turn_rate_radps == pytest.approx(mine.turn_rate_radps, rel=1e-15)
    # From the second writing on, the values are exact to the last digit.
    assert profile_from_text(profile_text(read)) == read


def test_whole_degrees_stay_whole() -> None:
    for degrees in range(-500, 501):
        step = Step(1, 0, math.radians(degrees))
        text = profile_text(MotionProfile("a", "", "", {"observer": (step,)}))
        assert degrees == 0 or f"turn_rate_deg: {degrees}}}" in text


@given(st.text(max_size=200))
def test_any_text_is_read_or_refused_in_one_line(text: str) -> None:
    for each in (text, MINIMAL + text, f"steps: {text}"):
        try:
            profile_from_text(each, "x")
        except InputError as error:
            assert "\n" not in str(error).strip()  # noqa: PT017


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (with_step("{seconds: 1, speed: 0.3}"), "obstacle step 2: 'speed' is not a key of a step; "
         "did you mean speed_mps?"),
        (with_step("{seconds: 1, turn_rate: 3}"), "did you mean turn_rate_deg?"),
        (MINIMAL + "gestur: true", "'gestur' is not a key of a programme; did you mean gesture?"),
        (MINIMAL + "zzz: 1", "the keys are name, title, help, gesture, steps"),
        ("name: a\nsteps: {obstacles: []}", "did you mean obstacle?"),
        (with_step("{seconds: 1, speed_mps: 2.3}"), r"within ±2.2 m/s, not 2.3"),
        (with_step("{seconds: 1, speed_mps: -2.3}"), r"within ±2.2 m/s"),
        (with_step("{seconds: 1, turn_rate_deg: 501}"), r"±500 degrees per second, not 501"),
        (with_step("{seconds: 0}"), "greater than 0 seconds"),
        (with_step("{seconds: -1}"), "greater than 0 seconds"),
        (with_step("{seconds: 3601}"), "at most 3600 seconds"),
        (with_step("{seconds: 3600}"), "1000 steps lasting 3600 seconds in total"),
        (with_step("{seconds: .nan}"), "seconds must be a plain number, not '.nan'"),
        (with_step("{seconds: 1e999}"), "finite"),
        (with_step("{seconds: true}"), "must be a plain number"),
        (with_step("{seconds: [1]}"), "must be a plain number"),
        (with_step("{seconds: 1, ramp: 1}"), "ramp must be true or false, not '1'"),
        (with_step("{speed_mps: 0.2}"), "obstacle step 2 has no seconds"),
        (with_step("{seconds: 1, seconds: 2}"), "appears twice"),
        (with_step("3"), "must be written as"),
        ("name: a\nsteps: {}", "moves no robot"),
        ("name: a\nsteps: [1]", "steps must contain a list of steps for observer or obstacle"),
        ("name: a\nsteps: {observer: {seconds: 1}}", "must be a list of steps"),
        ("name: ../etc\nsteps: {observer: [{seconds: 1}]}", "is not a valid programme name"),
        ('name: "a\\0"\nsteps: {observer: [{seconds: 1}]}', "is not a valid programme name"),
        ("title: [x]\n" + MINIMAL, "title must be text"),
        ("title: " + 121 * "x" + "\n" + MINIMAL, "title must be one line of at most 120"),
        ("", "must be YAML with name"),
        ("<steps/>", "must be YAML with name"),
        ("hello", "must be YAML with name"),
        (MINIMAL + "help: [", "not valid YAML"),
        (MINIMAL + "---\n" + MINIMAL, "more than one YAML document"),
    ],
)  # fmt: skip
def test_a_mistake_is_refused_with_a_specific_message(text: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as refused:
        profile_from_text(text)
    assert "calibration" not in str(refused.value)
    assert "OpenCV" not in str(refused.value)


def test_too_many_steps_are_refused() -> None:
    text = "name: a\nsteps: {observer: [" + 1001 * "{seconds: 0.1}," + "]}"
    with pytest.raises(InputError, match="at most 1000 steps"):
        profile_from_text(text)


def test_alias_bombs_large_and_deeply_nested_texts_are_refused() -> None:
    bomb = "name: a\nsteps: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"s{i}: &{chr(98 + i)} [" + ", ".join([f"*{chr(97 + i)}"] * 9) + "]\n" for i in range(20)
    )
    with pytest.raises(InputError, match="alias or anchor"):
        profile_from_text(bomb)
    with pytest.raises(InputError, match=f"at most {MAX_BYTES} are allowed"):
        profile_from_text(MINIMAL + "#" * MAX_BYTES)
    with pytest.raises(InputError, match="nested too deeply"):
        profile_from_text("steps: " + 5000 * "[" + 5000 * "]")


def test_steps_made_by_code_have_the_same_bounds() -> None:
    Step(1, MAX_SPEED_MPS, -MAX_TURN_RATE_RADPS)
    for values in ((1, math.inf), (1, math.nan), (1, 2.21), (1, 0, 9.0), (0, 0), (math.inf, 0)):
        with pytest.raises(InputError):
            Step(*values)
    with pytest.raises(InputError, match="'obstacles' is not a role"):
        MotionProfile("a", "", "", {"obstacles": (Step(1, 0.1),)})  # type: ignore[dict-item]

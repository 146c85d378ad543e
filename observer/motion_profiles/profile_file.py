"""Motion profiles as YAML: seconds, m/s and degrees per second; read strictly, written exactly.

name: to_and_fro
title: To and fro
help: The obstacle drives a metre and comes back.
gesture: true                 # false where it is left out
steps:
  obstacle:
    - {seconds: 1, speed_mps: 0.25, ramp: true}         # evenly from rest to 0.25 m/s
    - {seconds: 3, speed_mps: 0.25}
    - {seconds: 1, ramp: true}                          # a speed that is left out is 0
    - {seconds: 6, turn_rate_deg: 30}                   # to the left
"""

from __future__ import annotations

import json
import math
from typing import Annotated, TypeAlias

from pydantic import AfterValidator, BeforeValidator

from observer.errors import InputError
from observer.motion_profiles.profile import MotionProfile, Step
from observer.rig.rig import ROLES
from observer.text_files import (
    FileModel,
    Flag,
    Location,
    Number,
    PlainData,
    parse_text,
    validated,
    word,
)

# A thousand steps for each of two robots take 130 kB.
MAX_BYTES = 200_000

_Line: TypeAlias = Annotated[
    str, word("must be text"), AfterValidator(lambda text: " ".join(text.split()))
]


class _Step(FileModel):
    noun = "a step"
    form = "be written as {seconds: 2, speed_mps: 0.3, turn_rate_deg: 0}"

    seconds: Number | None = None
    speed_mps: Number = 0.0
    turn_rate_deg: Number = 0.0
    ramp: Flag = False


def _step(read: _Step) -> Step:
    if read.seconds is None:
        raise ValueError("has no seconds; specify its duration")
    try:
        return Step(read.seconds, read.speed_mps, math.radians(read.turn_rate_deg), read.ramp)
    except InputError as error:
        raise ValueError(str(error)) from None


def _listed(value: PlainData) -> PlainData:
    # Treat an empty value as if the role were left out.
    if value in ("", "null", "~"):
        return []
    if not isinstance(value, list):
        raise ValueError("must be a list of steps, each starting with -")
    return value


_Steps: TypeAlias = Annotated[
    tuple[Annotated[_Step, AfterValidator(_step)], ...], BeforeValidator(_listed)
]


class _Roles(FileModel):
    noun = "a role"
    form = f"contain a list of steps for {' or '.join(ROLES)}"

    observer: _Steps | None = None
    obstacle: _Steps | None = None


class _Profile(FileModel):
    noun = "a programme"

    name: _Line = ""
    title: _Line = ""
    help: _Line = ""
    gesture: Flag = False
    steps: _Roles


_KEYS = {*_Profile.model_fields, *_Roles.model_fields, *_Step.model_fields}


def _place(location: Location) -> str:
    """Return a place in a file in the form ``obstacle step 2: ramp``; unknown keys are quoted."""
    match location:
        case (*_, role, int(index)):
            return f"{role} step {index + 1}"
        case (*step, str(key)):
            word = key if key in _KEYS else repr(key[:40])
            return f"{_place(tuple(step))}: {word}" if len(step) > 2 else word
    return ""


def profile_from_text(text: str, name: str | None = None) -> MotionProfile:
    """Parse a motion profile from YAML text.

    Args:
        name: the profile's name if the text gives none, usually the stem of its file; it also
            identifies the text in messages.

    Raises:
        InputError: one sentence that names the key and what would be right. Unknown keys, values
            out of bounds, aliases and anchors, and texts of more than ``MAX_BYTES`` are refused,
            the last three before anything is built from them.
    """
    label = "the programme" if name is None else f"the programme {name[:60]}"
    size = len(text.encode("utf-8", "replace"))
    if size > MAX_BYTES:
        raise InputError(f"{label} has {size} bytes; at most {MAX_BYTES} are allowed")
    form = "YAML with name, title, help and steps"
    data = parse_text(text, name=label, what="a programme", form=form)
    read = validated(_Profile, data, label, _place)
    given = read.name or name
    if given is None:
        raise InputError(f"{label} has no name; add one, for example name: to_and_fro")
    return MotionProfile(
        name=given,
        title=read.title,
        help=read.help,
        steps={role: steps for role in ROLES if (steps := getattr(read.steps, role)) is not None},
        gesture=read.gesture,
    )


def profile_text(profile: MotionProfile) -> str:
    """Return the motion profile as YAML; reading it back gives an equal one.

    A turn rate that did not come from degrees may change once in its last digit.
    """
    lines = [
        f"name: {_quoted(profile.name)}",
        f"title: {_quoted(profile.title)}",
        f"help: {_quoted(profile.help)}",
        f"gesture: {str(profile.gesture).lower()}",
        "steps:",
    ]
    for role in profile.roles:
        lines.append(f"  {role}:")
        lines += [f"    - {{{_step_text(step)}}}" for step in profile.steps[role]]
    return "\n".join(lines) + "\n"


def _step_text(step: Step) -> str:
    parts = [f"seconds: {_digits(step.seconds)}", f"speed_mps: {_digits(step.speed_mps)}"]
    if step.turn_rate_radps:
        parts.append(f"turn_rate_deg: {_digits(_degrees(step.turn_rate_radps))}")
    if step.ramp:
        parts.append("ramp: true")
    return ", ".join(parts)


def _degrees(radians: float) -> float:
    """Return degrees that convert back to exactly these radians, in few digits if possible."""
    near = math.degrees(radians)
    below, above = math.nextafter(near, -math.inf), math.nextafter(near, math.inf)
    for candidate in (round(near, 6), round(near, 12), near, below, above):
        if math.radians(candidate) == radians:
            return candidate
    return near


def _digits(value: float) -> str:
    return str(int(value)) if float(value).is_integer() else repr(float(value))


def _quoted(text: str) -> str:
    # A JSON string of printable characters is valid YAML; quoted, "no" and "12" stay text.
    return json.dumps(text, ensure_ascii=False)

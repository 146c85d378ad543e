"""A programme as YAML text: seconds, m/s and degrees per second; read strictly, written exactly.

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

import difflib
import json
import math
import re
from collections.abc import Iterable

from observer.calibration.formats.plain_data import PlainData, parse_plain_data
from observer.errors import CalibrationError, InputError
from observer.motion_profiles.profile import Programme, Step
from observer.rig.rig import ROLES, Role

# A thousand steps for each of two robots have 130 kB.
MAX_BYTES = 200_000
_KEYS = ("name", "title", "help", "gesture", "steps")
_STEP_KEYS = ("seconds", "speed_mps", "turn_rate_deg", "ramp")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)


def programme_from_text(text: str, name: str | None = None) -> Programme:
    """The programme of a YAML text.

    Args:
        name: that of the programme where the text gives none, mostly its file's without ending;
            also what the text is called in messages.

    Raises:
        InputError: one sentence that names the key and what would be right. Unknown keys, values
            out of bounds, aliases and anchors, and texts of more than ``MAX_BYTES`` are refused,
            the last three before anything is built of them.
    """
    label = "the programme" if name is None else f"the programme {name[:60]}"
    size = len(text.encode("utf-8", "replace"))
    if size > MAX_BYTES:
        raise InputError(f"{label} has {size} bytes; at most {MAX_BYTES} are taken")
    # The reader knows other notations too, and speaks of calibrations where it finds no keys.
    if text.lstrip()[:1] in ("", "<") or re.search(r"\bsteps\b", text) is None:
        raise InputError(f"{label} must be YAML with name, title, help and steps")
    try:
        data = parse_plain_data(text, name=label)
    except CalibrationError as error:
        raise InputError(str(error)) from None
    _check_keys(data, _KEYS, "a programme", label)
    given = _text(data, "name", label) or name
    if given is None:
        raise InputError(f"{label} has no name; give one, such as name: to_and_fro")
    steps = data.get("steps")
    if not isinstance(steps, dict):
        raise InputError(f"{label}: steps must hold a list of steps for {' or '.join(ROLES)}")
    _check_keys(steps, ROLES, "a role", label)
    return Programme(
        name=given,
        title=_text(data, "title", label),
        help=_text(data, "help", label),
        steps={role: _steps(steps[role], role, label) for role in ROLES if role in steps},
        gesture=_yes(data, "gesture", label),
    )


def programme_text(programme: Programme) -> str:
    """The programme as YAML; reading it back gives the same one.

    A turn rate that was not written in degrees may change in its last digit, once.
    """
    lines = [
        f"name: {_quoted(programme.name)}",
        f"title: {_quoted(programme.title)}",
        f"help: {_quoted(programme.help)}",
        f"gesture: {str(programme.gesture).lower()}",
        "steps:",
    ]
    for role in programme.roles:
        lines.append(f"  {role}:")
        lines += [f"    - {{{_step_text(step)}}}" for step in programme.steps[role]]
    return "\n".join(lines) + "\n"


def _step_text(step: Step) -> str:
    parts = [f"seconds: {_digits(step.seconds)}", f"speed_mps: {_digits(step.speed_mps)}"]
    if step.turn_rate_radps:
        parts.append(f"turn_rate_deg: {_digits(_degrees(step.turn_rate_radps))}")
    if step.ramp:
        parts.append("ramp: true")
    return ", ".join(parts)


def _degrees(radians: float) -> float:
    """Degrees that are these very radians again, in few digits where few will do."""
    near = math.degrees(radians)
    below, above = math.nextafter(near, -math.inf), math.nextafter(near, math.inf)
    for candidate in (round(near, 6), round(near, 12), near, below, above):
        if math.radians(candidate) == radians:
            return candidate
    return near


def _digits(value: float) -> str:
    return str(int(value)) if float(value).is_integer() else repr(float(value))


def _quoted(text: str) -> str:
    # A JSON string of printable characters is a YAML one; in quotes, "no" and "12" stay words.
    return json.dumps(text, ensure_ascii=False)


def _steps(value: PlainData, role: Role, label: str) -> tuple[Step, ...]:
    # The same as a role that is not there.
    if value in ("", "null", "~"):
        return ()
    if not isinstance(value, list):
        raise InputError(f"{label}: steps.{role} must be a list of steps, each beginning with -")
    return tuple(_step(item, f"{role} step {i}", label) for i, item in enumerate(value, 1))


def _step(value: PlainData, where: str, label: str) -> Step:
    if not isinstance(value, dict):
        raise InputError(
            f"{label}: {where} must be written as {{seconds: 2, speed_mps: 0.3, turn_rate_deg: 0}}"
        )
    _check_keys(value, _STEP_KEYS, "a step", f"{label}: {where}")
    if "seconds" not in value:
        raise InputError(f"{label}: {where} has no seconds; say how long it lasts")
    try:
        return Step(
            seconds=_number(value, "seconds"),
            speed_mps=_number(value, "speed_mps"),
            turn_rate_radps=math.radians(_number(value, "turn_rate_deg")),
            ramp=_yes(value, "ramp", f"{label}: {where}"),
        )
    except InputError as error:
        sentence = str(error)
        if sentence.startswith(label):
            raise
        raise InputError(f"{label}: {where}: {sentence}") from None


def _number(data: dict[str, PlainData], key: str) -> float:
    text = data.get(key, "0")
    if not isinstance(text, str) or _NUMBER.fullmatch(text) is None:
        raise InputError(f"{key} must be a plain number, not {_shown(text)}")
    # Digits enough give infinity, which the step refuses.
    return float(text)


def _yes(data: dict[str, PlainData], key: str, label: str) -> bool:
    text = data.get(key, "false")
    if text not in ("true", "false"):
        raise InputError(f"{label}: {key} must be true or false, not {_shown(text)}")
    return text == "true"


def _text(data: dict[str, PlainData], key: str, label: str) -> str:
    """One line, empty where the key is not there."""
    text = data.get(key, "")
    if not isinstance(text, str):
        raise InputError(f"{label}: {key} must be text")
    return " ".join(text.split())


def _check_keys(data: Iterable[str], known: tuple[str, ...], what: str, label: str) -> None:
    for key in data:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1, cutoff=0.4)
            hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(known)}"
            raise InputError(f"{label}: {_shown(key)} is no key of {what}; {hint}")


def _shown(value: PlainData) -> str:
    return repr(value[:40]) if isinstance(value, str) else "several values"

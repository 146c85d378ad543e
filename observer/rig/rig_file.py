"""``rig.yaml``: metres and degrees, the unit in each key; read strictly, written back exactly.

mount:
  height_m: 0.41                              # a plain number was typed in
  tilt_deg: {estimated: 5.2, sigma: 0.3}      # estimated, with its standard deviation
  roll_deg: null                              # unknown, as is a key that is not there
  pan_deg: null
  forward_m: 0.05
  left_m: 0.06
calibration: 3f9c...                          # id of the calibration in use when measured
T_body_base:
  amigo: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -0.15]]    # rotation and metres
models: {observer: amigo-sh, obstacle: p3dx-sh}
ports: {observer: "/dev/ttyUSB0", obstacle: "socket://192.168.1.20:8101"}
for_simulated: false
"""

from __future__ import annotations

import math
import re
from typing import cast

from observer.calibration.formats.numbers import number_array
from observer.calibration.formats.plain_data import PlainData, parse_plain_data
from observer.errors import CalibrationError, InputError
from observer.geometry import Float64Array, Pose
from observer.rig.rig import MOUNT_KEYS, ROLES, Rig, RigMount, RigValue, RobotModel, Role

# A rig with a hundred mocap bodies has 15 kB.
_MAX_CHARACTERS = 100_000
_KEYS = ("mount", "calibration", "T_body_base", "models", "ports", "for_simulated")
_UNKNOWN = ("", "~", "null", "Null", "NULL", "None")
_ANGLE_OR_LENGTH = re.compile(r"(height|forward|left|tilt|roll|pan)(_\w+)?")


def read_rig(text: str, name: str) -> Rig:
    """The rig of a file's text (YAML, or JSON of the same keys).

    Args:
        name: what the text is called in messages, mostly ``rig.yaml``.

    Raises:
        InputError: one sentence naming the file, the key and what would be right. Unknown keys
            are refused, so a misspelt one is not silently left out.
    """
    if not text.strip():
        raise InputError(f"{name}: the file is empty; it must hold at least mount: with height_m")
    if len(text) > _MAX_CHARACTERS:
        raise InputError(f"{name}: a rig has at most {_MAX_CHARACTERS} characters, not {len(text)}")
    if text.lstrip().startswith("<"):
        raise InputError(f"{name}: a rig is written as YAML or JSON, not as XML")
    try:
        data = parse_plain_data(text, name=name)
        _check_keys(data, _KEYS, "", name)
        mount = _mount(_mapping(data, "mount", name), name)
        calibration = _text(data, "calibration", name)
        bodies = _bodies(_mapping(data, "T_body_base", name), name)
        models, ports = _models(data, name), _ports(data, name)
        for_simulated = _yes(data, "for_simulated", name)
    except CalibrationError as error:
        # The readers of text and numbers are those of calibrations; their sentences name the key.
        raise InputError(str(error)) from None
    try:
        return Rig(mount, calibration, bodies, models, for_simulated, ports)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def rig_text(rig: Rig) -> str:
    """The rig as YAML; reading it back gives every digit again."""
    known = rig.mount.values()
    lines = ["mount:"]
    lines += [f"  {key}: {_written(known.get(key))}" for key in MOUNT_KEYS]
    lines.append(f"calibration: {'null' if rig.calibration is None else _quoted(rig.calibration)}")
    lines.append("T_body_base:" if rig.T_body_base else "T_body_base: {}")
    for body, T_body_base in rig.T_body_base.items():
        lines.append(f"  {_quoted(body)}: {T_body_base.matrix[:3].tolist()}")
    models = ", ".join(f"{role}: {rig.models.get(role, 'null')}" for role in ROLES)
    lines.append(f"models: {{{models}}}")
    ports = ", ".join(
        f"{role}: {_quoted(rig.ports[role]) if role in rig.ports else 'null'}" for role in ROLES
    )
    lines.append(f"ports: {{{ports}}}")
    lines.append(f"for_simulated: {str(rig.for_simulated).lower()}")
    return "\n".join(lines) + "\n"


def _written(value: RigValue | None) -> str:
    if value is None:
        return "null"
    if value.sigma is None:
        return repr(float(value.value))
    return f"{{estimated: {float(value.value)!r}, sigma: {float(value.sigma)!r}}}"


def _quoted(word: str) -> str:
    # Names and ports hold neither quotes nor backslashes; in quotes, "no" and "12" stay names.
    return f'"{word}"'


def _mount(data: dict[str, PlainData], name: str) -> RigMount:
    _check_keys(data, MOUNT_KEYS, "mount.", name)
    values = {
        key: _value(item, f"mount.{key}", name) for key, item in data.items() if not _unknown(item)
    }
    try:
        return RigMount(**values)
    except InputError as error:
        raise InputError(f"{name}: mount.{error}") from None


def _value(item: PlainData, key: str, name: str) -> RigValue:
    if not isinstance(item, dict):
        return RigValue(_number(item, key, name))
    _check_keys(item, ("estimated", "sigma"), f"{key}.", name)
    for part in ("estimated", "sigma"):
        if part not in item:
            raise InputError(
                f"{name}: {key}.{part} is missing; an estimate is written as "
                f"{{estimated: VALUE, sigma: STANDARD DEVIATION}}, a typed value as a plain number"
            )
    value = _number(item["estimated"], f"{key}.estimated", name)
    sigma = _number(item["sigma"], f"{key}.sigma", name)
    if not sigma > 0:
        raise InputError(
            f"{name}: {key}.sigma must be a positive standard deviation, not {sigma:g}"
        )
    return RigValue(value, sigma)


def _number(item: PlainData, key: str, name: str) -> float:
    array = number_array(item, key=key, name=name) if not isinstance(item, dict) else None
    if array is None or array.size != 1 or isinstance(item, list):
        raise InputError(f"{name}: {key} must be one number")
    number = float(array.reshape(-1)[0])
    if not math.isfinite(number):
        raise InputError(f"{name}: {key} must be a finite number")
    return number


def _bodies(data: dict[str, PlainData], name: str) -> dict[str, Pose]:
    return {body: _pose(item, f"T_body_base.{body[:60]}", name) for body, item in data.items()}


def _pose(item: PlainData, key: str, name: str) -> Pose:
    right = "3 or 4 rows of 4 numbers: a rotation, and metres in the last column"
    if not isinstance(item, list):
        raise InputError(f"{name}: {key} must hold {right}")
    matrix: Float64Array = number_array(item, key=key, name=name)
    if matrix.shape not in ((3, 4), (4, 4)):
        raise InputError(f"{name}: {key} must hold {right}")
    if matrix.shape == (4, 4) and matrix[3].tolist() != [0, 0, 0, 1]:
        raise InputError(f"{name}: the last row of {key} must be 0 0 0 1")
    try:
        return Pose.from_matrix(matrix)
    except ValueError:
        raise InputError(
            f"{name}: the first three columns of {key} must be a rotation (R^T R = I, det R = +1)"
        ) from None


def _models(data: dict[str, PlainData], name: str) -> dict[Role, RobotModel]:
    found = _words(_mapping(data, "models", name), f"{name}: models", "a model's name")
    return cast("dict[Role, RobotModel]", found)


def _ports(data: dict[str, PlainData], name: str) -> dict[Role, str]:
    found = _words(_mapping(data, "ports", name), f"{name}: ports", "a path or address")
    return cast("dict[Role, str]", found)


def _words(data: dict[str, PlainData], where: str, what: str) -> dict[str, str]:
    """Those that are known; roles and words are checked by Rig, whose sentences name them."""
    found: dict[str, str] = {}
    for role, word in data.items():
        if _unknown(word):
            continue
        if not isinstance(word, str):
            raise InputError(f"{where}.{role[:60]} must be {what}")
        found[role] = word
    return found


def _mapping(data: dict[str, PlainData], key: str, name: str) -> dict[str, PlainData]:
    item = data.get(key, {})
    if _unknown(item):
        return {}
    if not isinstance(item, dict):
        raise InputError(f"{name}: {key} must hold keys with values, not {str(item)[:40]!r}")
    return item


def _text(data: dict[str, PlainData], key: str, name: str) -> str | None:
    item = data.get(key, "")
    if _unknown(item):
        return None
    if not isinstance(item, str):
        raise InputError(f"{name}: {key} must be one word")
    return item


def _yes(data: dict[str, PlainData], key: str, name: str) -> bool:
    item = data.get(key, "false")
    if item in ("true", "True", "false", "False"):
        return item in ("true", "True")
    raise InputError(f"{name}: {key} must be true or false, not {str(item)[:40]!r}")


def _unknown(item: PlainData) -> bool:
    return isinstance(item, str) and item in _UNKNOWN


def _check_keys(
    data: dict[str, PlainData], allowed: tuple[str, ...], prefix: str, name: str
) -> None:
    for key in data:
        if key in allowed:
            continue
        hint = ""
        if prefix == "mount." and (like := _ANGLE_OR_LENGTH.fullmatch(key)):
            meant = next(known for known in allowed if known.startswith(like[1]))
            unit = "metres" if meant.endswith("_m") else "degrees"
            hint = f"; it is given in {unit} as {meant}"
        raise InputError(
            f"{name}: {prefix}{key[:60]} is no key of a rig{hint or '; there are '}"
            f"{'' if hint else ', '.join(prefix + known for known in allowed)}"
        )

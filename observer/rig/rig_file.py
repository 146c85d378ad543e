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

import re
from typing import Annotated, ClassVar, TypeAlias, cast

from pydantic import (
    BeforeValidator,
    Field,
    PlainValidator,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)

from observer.calibration.formats.numbers import finite_numbers
from observer.errors import InputError
from observer.geometry import Pose
from observer.rig.rig import MOUNT_KEYS, ROLES, Rig, RigMount, RigValue, RobotModel, Role
from observer.text_files import FileModel, Flag, PlainData, parse_text, shown, validated, word

# A rig with a hundred mocap bodies has 15 kB.
_MAX_CHARACTERS = 100_000
_UNKNOWN = ("", "~", "null", "Null", "NULL", "None")
_ANGLE_OR_LENGTH = re.compile(r"(height|forward|left|tilt|roll|pan)(_\w+)?")


def _known(data: PlainData) -> PlainData:
    """Return a mapping without its unknown values."""
    if data in _UNKNOWN:
        return {}
    if not isinstance(data, dict):
        raise ValueError(f"must contain keys with values, not {shown(data)}")
    return {key: value for key, value in data.items() if value not in _UNKNOWN}


_KNOWN = BeforeValidator(_known)


def _number(value: PlainData) -> float:
    array = finite_numbers(value) if isinstance(value, str) else None
    if array is None or array.size != 1:
        raise ValueError("must be one number")
    return float(array[0])


def _deviation(value: PlainData) -> float:
    if not (number := _number(value)) > 0:
        raise ValueError(f"must be a positive standard deviation, not {number:g}")
    return number


def _pose(value: PlainData) -> Pose:
    matrix = finite_numbers(value) if isinstance(value, list) else None
    if matrix is None or matrix.shape not in ((3, 4), (4, 4)):
        raise ValueError(
            "must contain 3 or 4 rows of 4 numbers: a rotation, and metres in the last column"
        )
    if matrix.shape == (4, 4) and matrix[3].tolist() != [0, 0, 0, 1]:
        raise ValueError("the last row of {at} must be 0 0 0 1")
    try:
        return Pose.from_matrix(matrix)
    except ValueError:
        raise ValueError(
            "the first three columns of {at} must be a rotation (R^T R = I, det R = +1)"
        ) from None


class _Estimate(FileModel):
    noun = "an estimate"
    missing = (
        "is missing; write an estimate as {estimated: VALUE, sigma: STANDARD DEVIATION}, a typed "
        "value as a plain number"
    )

    estimated: Annotated[float, PlainValidator(_number)]
    sigma: Annotated[float, PlainValidator(_deviation)]


def _value(item: PlainData, estimate: ValidatorFunctionWrapHandler) -> RigValue:
    if not isinstance(item, dict):
        return RigValue(_number(item))
    read: _Estimate = estimate(item)
    return RigValue(read.estimated, read.sigma)


_Value: TypeAlias = Annotated[_Estimate, WrapValidator(_value)]


class _Keys(FileModel):
    noun = "a rig"
    unset = _UNKNOWN
    prefix: ClassVar[str] = ""

    @classmethod
    def unknown(cls, key: str) -> str:
        like = _ANGLE_OR_LENGTH.fullmatch(key)
        meant = next(
            (known for known in cls.model_fields if like and known.startswith(like[1])), ""
        )
        if meant:
            unit = "metres" if meant.endswith("_m") else "degrees"
            return f"is not a key of a rig; it is given in {unit} as {meant}"
        return (
            "is not a key of a rig; the keys are "
            f"{', '.join(cls.prefix + k for k in cls.model_fields)}"
        )


class _Mount(_Keys):
    prefix = "mount."

    height_m: _Value | None = None
    tilt_deg: _Value | None = None
    roll_deg: _Value | None = None
    pan_deg: _Value | None = None
    forward_m: _Value | None = None
    left_m: _Value | None = None


class _Rig(_Keys):
    mount: _Mount = _Mount()
    calibration: Annotated[str, word("must be one word")] | None = None
    T_body_base: Annotated[dict[str, Annotated[Pose, PlainValidator(_pose)]], _KNOWN] = Field({})
    # Rig checks roles and words; its error messages name them.
    models: Annotated[dict[str, Annotated[str, word("must be a model's name")]], _KNOWN] = Field({})
    ports: Annotated[dict[str, Annotated[str, word("must be a path or address")]], _KNOWN] = Field(
        {}
    )
    for_simulated: Flag = False


def read_rig(text: str, name: str) -> Rig:
    """The rig of a file's text (YAML, or JSON of the same keys).

    Args:
        name: what the text is called in messages, usually ``rig.yaml``.

    Raises:
        InputError: one sentence naming the file, the key and what would be right. Unknown keys
            are refused, so a misspelt one is not silently left out.
    """
    form = "YAML or JSON with at least mount: and height_m in it"
    data = parse_text(text, name=name, what="a rig", form=form, most=_MAX_CHARACTERS)
    read = validated(_Rig, data, name)
    try:
        mount = RigMount(**{key: getattr(read.mount, key) for key in MOUNT_KEYS})
    except InputError as error:
        raise InputError(f"{name}: mount.{error}") from None
    try:
        return Rig(
            mount,
            read.calibration,
            read.T_body_base,
            cast("dict[Role, RobotModel]", read.models),
            read.for_simulated,
            cast("dict[Role, str]", read.ports),
        )
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

"""Rig: what is known about the robot that carries the cameras, and where each number is from."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Final, Literal, get_args

from observer.errors import InputError
from observer.geometry import Pose
from observer.mount import CameraMount

Role = Literal["observer", "obstacle"]
# The observer carries the cameras, and only it is sent to goals.
OBSERVER: Final = "observer"
OBSTACLE: Final = "obstacle"
RobotModel = Literal["p3dx-sh", "p3dx", "amigo-sh", "amigo"]
ROLES: tuple[Role, ...] = get_args(Role)
ROBOT_MODELS: tuple[RobotModel, ...] = get_args(RobotModel)

# Lowest and highest values, inclusive, for a camera on an indoor robot; a value outside is mistyped
# or in other units.
LIMITS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "height_m": (0.02, 3.0),
        "tilt_deg": (-89.0, 89.0),
        "roll_deg": (-45.0, 45.0),
        "pan_deg": (-180.0, 180.0),
        "forward_m": (-2.0, 2.0),
        "left_m": (-2.0, 2.0),
    }
)
# A mocap body's origin is the centre of its markers, which are on the robot.
_LARGEST_BODY_OFFSET_M = 10.0
# As mocap systems name bodies; no quotes, backslashes or control characters.
_BODY_NAME = re.compile(r"[\w][\w .:/()#+-]{0,63}")
_CALIBRATION_ID = re.compile(r"[0-9A-Za-z][0-9A-Za-z._:-]{0,127}")
# Paths and addresses; ``observer.robot_opening`` decides which of them name a port.
_PORT = re.compile(r"(?=\S)[^\x00-\x1f\x7f\"\\]{1,200}(?<=\S)")


@dataclass(frozen=True)
class RigValue:
    """A number and where it comes from; its key states the unit.

    Attributes:
        value: finite. sigma: one standard deviation of an estimate, same unit; None where a
            person typed the value.

    Raises:
        InputError: the number is not finite, or the standard deviation not positive.
    """

    value: float
    sigma: float | None = None

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            raise InputError(f"a value of the rig must be a finite number, not {self.value}")
        if self.sigma is not None and not (math.isfinite(self.sigma) and self.sigma > 0):
            raise InputError(
                f"the standard deviation of an estimate must be positive, not {self.sigma}"
            )

    @property
    def origin(self) -> Literal["typed", "estimated"]:
        return "typed" if self.sigma is None else "estimated"


@dataclass(frozen=True)
class RigMount:
    """Mount of the rectified left camera; see ``observer.mount.CameraMount`` for the axes.

    Metres and degrees, because people write and read these; None where unknown.

    Attributes:
        height_m: above the floor. tilt_deg: down. roll_deg: right side down. pan_deg: to the left
            of the driving direction. forward_m, left_m: from the middle of the axle.

    Raises:
        InputError: a value is outside ``LIMITS``; the sentence begins with its key.
    """

    height_m: RigValue | None = None
    tilt_deg: RigValue | None = None
    roll_deg: RigValue | None = None
    pan_deg: RigValue | None = None
    forward_m: RigValue | None = None
    left_m: RigValue | None = None

    def __post_init__(self) -> None:
        for key, known in self.values().items():
            low, high = LIMITS[key]
            if not low <= known.value <= high:
                unit = "metres" if key.endswith("_m") else "degrees"
                raise InputError(
                    f"{key} must be between {low:g} and {high:g} {unit}, not {known.value:g}"
                )

    def values(self) -> dict[str, RigValue]:
        """Return the known values by key, in the order of the file."""
        listed = ((f.name, getattr(self, f.name)) for f in fields(self))
        return {key: value for key, value in listed if value is not None}


MOUNT_KEYS: tuple[str, ...] = tuple(f.name for f in fields(RigMount))


@dataclass(frozen=True, eq=False)
class Rig:
    """The robot that carries the cameras.

    Attributes:
        mount: of the left camera; each value may be unknown.
        calibration: content hash of the calibration the mount was measured with: tilt, roll and
            pan are those of the rectified camera, which another calibration rotates slightly.
        T_body_base: for each body of a mocap system, by its name there, the robot's base in the
            body's axes.
        models: of the robots by role; a role without a model is unknown.
        ports: of the real robots by role, as ``observer.robot_opening.open_robot`` takes them.
        for_simulated: whether simulated sources, which know their own mount exactly, use this
            rig's instead; to try the rig out.

    Raises:
        InputError: one sentence that begins with the key and says what would be right.
    """

    mount: RigMount = RigMount()
    calibration: str | None = None
    T_body_base: Mapping[str, Pose] = field(default_factory=dict)
    models: Mapping[Role, RobotModel] = field(default_factory=dict)
    for_simulated: bool = False
    ports: Mapping[Role, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.calibration is not None and not _CALIBRATION_ID.fullmatch(self.calibration):
            raise InputError(
                f"calibration must be a calibration's id (letters and digits), "
                f"not {self.calibration[:40]!r}"
            )
        for name, T_body_base in self.T_body_base.items():
            if not _BODY_NAME.fullmatch(name):
                raise InputError(
                    "T_body_base: a body's name must be up to 64 letters, digits, spaces or . : / "
                    f"( ) # + - and start with a letter or digit, not {name[:40]!r}"
                )
            if abs(T_body_base.translation).max() > _LARGEST_BODY_OFFSET_M:
                raise InputError(
                    f"T_body_base.{name} must be within {_LARGEST_BODY_OFFSET_M:g} metres of the "
                    "body; divide millimetres by 1000"
                )
        for role, model in self.models.items():
            _check_role("models", role)
            if model not in ROBOT_MODELS:
                raise InputError(
                    f"models.{role} must be one of {', '.join(ROBOT_MODELS)}, "
                    f"not {str(model)[:40]!r}"
                )
        for role, port in self.ports.items():
            _check_role("ports", role)
            if not _PORT.fullmatch(port) or not port.isprintable():
                raise InputError(
                    f"ports.{role} must be a path or address of up to 200 characters without "
                    "quotes or backslashes, for example /dev/ttyUSB0 or socket://192.168.1.20:8101"
                )
        if len(set(self.ports.values())) < len(self.ports):
            raise InputError("ports must name two different ports, one for each robot")
        for name in ("T_body_base", "models", "ports"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    @property
    def camera_mount(self) -> CameraMount | None:
        """The mount in radians, as the method uses it; None where height or tilt is unknown."""
        return camera_mount(self.mount.values())


def _check_role(key: str, role: str) -> None:
    if role not in ROLES:
        raise InputError(
            f"{key}.{str(role)[:40]} is not a role; the roles are {' and '.join(ROLES)}"
        )


def camera_mount(values: Mapping[str, RigValue]) -> CameraMount | None:
    """Return the mount with ``RigMount``'s values; None where height or tilt is unknown."""
    known = {key: value.value for key, value in values.items()}
    if "height_m" not in known or "tilt_deg" not in known:
        return None
    return CameraMount(
        known["height_m"],
        math.radians(known["tilt_deg"]),
        known.get("forward_m"),
        known.get("left_m"),
        roll_rad=math.radians(known.get("roll_deg", 0.0)),
        pan_rad=math.radians(known.get("pan_deg", 0.0)),
    )

"""Scenarios are data: what stands in the lab, who drives where, and what ails the cameras.

A scenario is a YAML file; the built-in ones lie in the folder ``scenarios`` beside this file.
Positions are in the room frame: x forward, y left, z up, metres, the origin on the floor where
the observer starts. Seed 0 is the scenario as it is written; any other seed draws textures,
layout and motion anew within ``variation``.
"""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from observer.errors import ScenarioError

# P3-DX: 455 x 381 x 237 mm (MobileRobots data sheet), AmigoBot: 330 x 280 x 150 mm.
P3DX_SIZE = (0.455, 0.381, 0.237)
AMIGOBOT_SIZE = (0.33, 0.28, 0.15)

Fraction = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0, le=1000)]
Finite = Annotated[float, Field(ge=-1000, le=1000)]
Degrees = Annotated[float, Field(ge=-3600, le=3600)]


class _Spec(BaseModel):
    """Frozen, and strict about unknown keys: a misspelt key is an error, not a default."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class CameraSpec(_Spec):
    """The stereo pair and how it is mounted on the observer."""

    width: int = Field(512, ge=64, le=4096)
    height: int = Field(256, ge=64, le=4096)
    baseline_m: float = Field(0.12, gt=0, le=1)
    hfov_deg: float = Field(60.0, ge=10, le=120)
    height_m: float = Field(0.40, ge=0.05, le=3)
    tilt_deg: float = Field(5.0, ge=-60, le=60)
    forward_m: float = Field(0.05, ge=-1, le=1)


class RoomSpec(_Spec):
    """A rectangular room. ``walls`` and ``floor`` name how they are painted."""

    x: tuple[Finite, Finite] = (-2.5, 6.0)
    y: tuple[Finite, Finite] = (-3.5, 3.5)
    height_m: float = Field(2.8, ge=1, le=20)
    floor: Literal["wood", "tiles"] = "wood"
    walls: Literal["painted", "panels"] = "painted"

    @model_validator(mode="after")
    def _is_a_room(self) -> RoomSpec:
        for name, (low, high) in (("x", self.x), ("y", self.y)):
            if not 1 <= high - low <= 60:
                raise ValueError(f"room.{name} must span 1 to 60 m, lower end first")
        return self


class BoxSpec(_Spec):
    """A crate or a cardboard box on the floor, or on another one (``above_m``)."""

    kind: Literal["crate", "cardboard", "cabinet"]
    x: Finite
    y: Finite
    heading_deg: Degrees = 0.0
    size: tuple[Positive, Positive, Positive] = (0.5, 0.5, 0.5)
    above_m: float = Field(0.0, ge=0, le=10)


class PosterSpec(_Spec):
    """A picture on a wall.

    ``wall`` is named as seen from the start; ``along_m`` is y on the front and back wall and x
    on the left and right one; ``height_m`` is the height of the picture's centre.
    """

    kind: Literal["poster"]
    wall: Literal["front", "back", "left", "right"]
    along_m: Finite
    height_m: float = Field(0.9, gt=0, le=20)
    size: tuple[Positive, Positive] = (0.6, 0.8)
    design: Literal["rings", "blocks", "map", "waves", "tag", "sign", "checkerboard"] = "rings"


ObjectSpec = Annotated[BoxSpec | PosterSpec, Field(discriminator="kind")]


class DriveLeg(_Spec):
    """Straight on, or backwards with a negative distance."""

    kind: Literal["drive"]
    distance_m: Finite
    speed: float = Field(gt=0, le=20)


class ArcLeg(_Spec):
    """Along a circle; a positive angle is to the left."""

    kind: Literal["arc"]
    radius_m: Positive
    angle_deg: Degrees
    speed: float = Field(gt=0, le=20)


class TurnLeg(_Spec):
    """On the spot; a positive angle is to the left."""

    kind: Literal["turn"]
    angle_deg: Degrees
    rate_deg: float = Field(gt=0, le=720)


class WaitLeg(_Spec):
    """Stands still."""

    kind: Literal["wait"]
    seconds: Positive


LegSpec = Annotated[DriveLeg | ArcLeg | TurnLeg | WaitLeg, Field(discriminator="kind")]


class CourseSpec(_Spec):
    """Legs driven one after the other."""

    kind: Literal["course"]
    legs: tuple[LegSpec, ...] = Field(min_length=1)
    after: Literal["stay", "repeat", "back"] = "stay"
    acceleration: float = Field(0.5, gt=0, le=50)
    angular_acceleration_deg: float = Field(100.0, gt=0, le=10000)


class WaypointsSpec(_Spec):
    """From point to point at one speed, turning on the spot towards the next one."""

    kind: Literal["waypoints"]
    points: tuple[tuple[Finite, Finite], ...] = Field(min_length=1)
    speed: float = Field(gt=0, le=20)
    turn_rate_deg: float = Field(45.0, gt=0, le=720)
    after: Literal["stay", "repeat", "back"] = "stay"
    acceleration: float = Field(0.5, gt=0, le=50)
    angular_acceleration_deg: float = Field(100.0, gt=0, le=10000)


class SineSpec(_Spec):
    """``amplitude sin(2 pi t / period + phase)``."""

    amplitude: float = Field(0.0, ge=-1000, le=1000)
    period_s: Positive = 10.0
    phase_deg: Degrees = 0.0


class SwaySpec(_Spec):
    """Sines about the start pose; ``turn`` in degrees, the others in metres."""

    kind: Literal["sway"]
    forward: SineSpec = SineSpec()
    left: SineSpec = SineSpec()
    turn: SineSpec = SineSpec()


MotionSpec = Annotated[CourseSpec | WaypointsSpec | SwaySpec, Field(discriminator="kind")]


class VehicleSpec(_Spec):
    """Where a vehicle starts and how it moves; without motion it is parked."""

    x: Finite = 0.0
    y: Finite = 0.0
    heading_deg: Degrees = 0.0
    motion: MotionSpec | None = None


class RobotSpec(VehicleSpec):
    """A P3-DX; higher than 0.237 m it carries a payload up to its height."""

    name: str = Field("P3-DX", min_length=1, max_length=40)
    size: tuple[Positive, Positive, Positive] = P3DX_SIZE


class TextureSpec(_Spec):
    """How much there is to see.

    Attributes:
        contrast: of every texture; 1 as painted, 0 uniform colours.
        share_without: share of the walls and the floor that is left without texture.
        robot: ``red`` as a P3-DX looks, or ``dark``: dark and weakly textured.
    """

    contrast: float = Field(1.0, ge=0, le=2)
    share_without: Fraction = 0.0
    robot: Literal["red", "dark"] = "red"


class ShakeSpec(_Spec):
    """Motion of the camera against the vehicle, sines; angles in degrees, ``up`` in metres.

    Small and quick it is a vibrating mount, large and slow the flight of an aerial vehicle.
    """

    roll: SineSpec = SineSpec()
    pitch: SineSpec = SineSpec()
    yaw: SineSpec = SineSpec()
    up: SineSpec = SineSpec()


class LensSpec(_Spec):
    """Radial and tangential distortion of both lenses, OpenCV's model."""

    k1: float = Field(0.0, ge=-0.6, le=0.6)
    k2: float = Field(0.0, ge=-0.6, le=0.6)
    p1: float = Field(0.0, ge=-0.05, le=0.05)
    p2: float = Field(0.0, ge=-0.05, le=0.05)


class TiltSpec(_Spec):
    """Rotation of the right camera against the left one, degrees about x, y and z."""

    pitch_deg: float = Field(0.0, ge=-5, le=5)
    vergence_deg: float = Field(0.0, ge=-5, le=5)
    roll_deg: float = Field(0.0, ge=-5, le=5)


class MiscalibrationSpec(TiltSpec):
    """What the calibration that is handed out says beyond the truth; ``focal`` is relative."""

    focal: float = Field(0.0, ge=-0.2, le=0.2)


class FlickerSpec(_Spec):
    """Brightness of the light, ``1 + amplitude sin(2 pi hz t)``."""

    amplitude: Fraction = 0.0
    hz: float = Field(2.0, gt=0, le=1000)


class FaultSpec(_Spec):
    """What ails the cameras.

    Attributes:
        noise: standard deviation, grey levels, independent in both cameras.
        gain: the right camera is brighter by this share.
        blur_px: standard deviation of a Gaussian (out of focus), pixels.
        exposure_s: length of the exposure, during which motion blurs; the mean instant counts.
        exposure_samples: instants that are rendered and averaged over the exposure.
        skew_s: the right camera exposes later by this time; free-running cameras.
        readout_s: rolling shutter: from the exposure of the first to that of the last row.
    """

    noise: float = Field(0.0, ge=0, le=30)
    gain: float = Field(0.0, ge=-0.9, le=2)
    flicker: FlickerSpec = FlickerSpec()
    blur_px: float = Field(0.0, ge=0, le=20)
    exposure_s: float = Field(0.0, ge=0, le=0.5)
    exposure_samples: int = Field(5, ge=2, le=32)
    skew_s: float = Field(0.0, ge=-0.5, le=0.5)
    readout_s: float = Field(0.0, ge=0, le=0.2)
    lens: LensSpec = LensSpec()
    tilt: TiltSpec = TiltSpec()
    miscalibration: MiscalibrationSpec = MiscalibrationSpec()


class VariationSpec(_Spec):
    """What a seed other than 0 changes, drawn uniformly within plus and minus these bounds.

    Attributes:
        position_m, heading_deg: of every start and every object.
        speed: relative, of each vehicle.
    """

    position_m: float = Field(0.0, ge=0, le=2)
    heading_deg: float = Field(0.0, ge=0, le=45)
    speed: float = Field(0.0, ge=0, le=0.8)


class Scenario(_Spec):
    """A simulated world and its motions.

    Attributes:
        name: the file's name without its ending.
        declares: ``ideal`` where the method must be right, ``faulty`` where the cameras or
            their calibration are worse than a stereo method may assume.
        scored_for: ``everything``, or ``detection`` where the fault biases depth as such, so that
            errors of position and speed are no figures of the method: then only its status,
            detection and coverage count.
        benchmark: whether ``benchmark`` counts it; the lab is for showing.
    """

    name: str = Field(min_length=1)
    title: str = Field(min_length=1)
    help: str = Field(min_length=1)
    declares: Literal["ideal", "faulty"]
    scored_for: Literal["everything", "detection"] = "everything"
    benchmark: bool = True
    duration_s: float = Field(gt=0, le=3600)
    frame_rate: float = Field(15.0, gt=0, le=240)
    camera: CameraSpec = CameraSpec()
    room: RoomSpec = RoomSpec()
    objects: tuple[ObjectSpec, ...] = ()
    robots: tuple[RobotSpec, ...] = ()
    observer: VehicleSpec = VehicleSpec()
    shake: ShakeSpec = ShakeSpec()
    texture: TextureSpec = TextureSpec()
    faults: FaultSpec = FaultSpec()
    variation: VariationSpec = VariationSpec()

    @property
    def frame_count(self) -> int:
        return max(1, round(self.duration_s * self.frame_rate))


def scenario_names() -> tuple[str, ...]:
    """Names of the built-in scenarios, the default one first, the others in order."""
    names = sorted(
        entry.name.removesuffix(".yaml")
        for entry in _folder().iterdir()
        if entry.name.endswith(".yaml") and not entry.name.startswith("_")
    )
    return tuple(sorted(names, key=lambda name: name != "lab"))


def load_scenario(name: str) -> Scenario:
    """A built-in scenario by its name, or a scenario file by its path.

    A file may start from a built-in one: ``based_on: NAME`` takes over every key that the file
    does not give itself; mappings are merged, lists replaced.

    Raises:
        ScenarioError: there is no such scenario, or one sentence on what is wrong in the file.
    """
    if name in scenario_names():
        text = _folder().joinpath(f"{name}.yaml").read_text(encoding="utf-8")
        return scenario_from_text(text, name)
    path = Path(name)
    if path.suffix not in (".yaml", ".yml"):
        raise ScenarioError(
            f"there is no scenario {name!r}; there are {', '.join(scenario_names())}, "
            f"or give the path of a .yaml file"
        )
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ScenarioError(f"there is no scenario file {path}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"the scenario file {path} cannot be read: {error}") from None
    return scenario_from_text(text, path.stem)


def scenario_from_text(text: str, name: str) -> Scenario:
    """A scenario from YAML text.

    Raises:
        ScenarioError: one sentence that names the key and what would be right.
    """
    try:
        return Scenario.model_validate({"name": name, **_mapping(text, name, depth=0)})
    except ValidationError as error:
        problem = error.errors(include_url=False, include_context=False)[0]
        key = ".".join(str(part) for part in problem["loc"])
        message = problem["msg"].removeprefix("Value error, ")
        message = message[:1].lower() + message[1:]
        raise ScenarioError(f"scenario {name}: {f'{key}: ' if key else ''}{message}") from None


def _mapping(text: str, name: str, depth: int) -> dict[str, Any]:
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark is not None else ""
        raise ScenarioError(f"scenario {name} is not valid YAML{where}") from None
    if not isinstance(data, dict):
        raise ScenarioError(f"scenario {name} must be a YAML mapping with a title and motions")
    base = data.pop("based_on", None)
    if base is None:
        return data
    source = _folder().joinpath(f"{base}.yaml")
    if not isinstance(base, str) or "/" in base or not source.is_file():
        raise ScenarioError(f"scenario {name}: based_on: there is no built-in scenario {base!r}")
    if depth > 5:
        raise ScenarioError(f"scenario {name}: based_on: the scenarios are based on each other")
    return _merged(_mapping(source.read_text(encoding="utf-8"), base, depth + 1), data)


def _merged(base: dict[str, Any], change: dict[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in change.items():
        old = result.get(key)
        result[key] = (
            _merged(old, value)
            if isinstance(old, dict) and isinstance(value, dict) and "kind" not in value
            else value
        )
    return result


def _folder() -> Traversable:
    return resources.files("observer.simulation") / "scenarios"

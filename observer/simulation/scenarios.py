"""Scenarios as data: the lab's contents, its vehicles' motions, and the cameras' faults.

A scenario is a YAML file; the built-in ones lie in the folder ``scenarios`` beside this file, and
their keys are the fields of the classes in ``specs``. Positions are in the room frame: x forward,
y left, z up, metres, the origin on the floor where the observer starts. Seed 0 is the scenario as
it is written; any other seed redraws textures, layout and motion within ``variation``.
"""

from __future__ import annotations

import difflib
import functools
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, ValidationError

from observer.errors import InputError, ScenarioError
from observer.simulation.specs.base import Spec
from observer.simulation.specs.boards import BoardSpec
from observer.simulation.specs.cameras import CameraSpec, FaultSpec, ShakeSpec
from observer.simulation.specs.people import PersonSpec
from observer.simulation.specs.places import ObjectSpec, RoomSpec, TextureSpec
from observer.simulation.specs.vehicles import RobotSpec, VehicleSpec
from observer.text_files import parse_text, problem, read_text

_FORM = "a YAML mapping with a title and motions"


class VariationSpec(Spec):
    """Variation by a seed other than 0, drawn uniformly within plus and minus these bounds.

    Attributes:
        position_m, heading_deg: of every start and every object.
        speed: relative, of each vehicle and person.
        stature_m: of each person's height. build: of each person's girth, relative. Clothes that
            the scenario leaves open are drawn too.
        board_shift: of the board's poses, as a share of their depth.
        board_turn_deg: of the board's poses, about each axis.
    """

    position_m: float = Field(0.0, ge=0, le=2)
    heading_deg: float = Field(0.0, ge=0, le=45)
    speed: float = Field(0.0, ge=0, le=0.8)
    stature_m: float = Field(0.0, ge=0, le=0.2)
    build: float = Field(0.0, ge=0, le=0.3)
    board_shift: float = Field(0.0, ge=0, le=0.5)
    board_turn_deg: float = Field(0.0, ge=0, le=45)


class Scenario(Spec):
    """A simulated world and its motions.

    Attributes:
        name: the file's name without its extension.
        declares: ``ideal`` if the method must be right, ``faulty`` if the cameras or their
            calibration are worse than a stereo method may assume. It says nothing about whether
            robots or people move; the ground truth does.
        scored_for: ``everything``, or ``detection`` if the fault biases depth itself, so that
            position and speed errors say nothing about the method: then only its status,
            detection and coverage count.
        benchmark: whether ``benchmark`` includes it; the lab is only a demonstration.
        hands_out_calibration: whether the source provides a calibration; a camera that was just
            plugged in does not.
        board: held by a person before the cameras; not an obstacle and not scored.
    """

    name: str = Field(min_length=1)
    title: str = Field(min_length=1)
    help: str = Field(min_length=1)
    declares: Literal["ideal", "faulty"]
    scored_for: Literal["everything", "detection"] = "everything"
    benchmark: bool = True
    hands_out_calibration: bool = True
    duration_s: float = Field(gt=0, le=3600)
    frame_rate: float = Field(15.0, gt=0, le=240)
    camera: CameraSpec = CameraSpec()
    room: RoomSpec = RoomSpec()
    objects: tuple[ObjectSpec, ...] = ()
    robots: tuple[RobotSpec, ...] = ()
    people: tuple[PersonSpec, ...] = ()
    observer: VehicleSpec = VehicleSpec()
    board: BoardSpec | None = None
    shake: ShakeSpec = ShakeSpec()
    texture: TextureSpec = TextureSpec()
    faults: FaultSpec = FaultSpec()
    variation: VariationSpec = VariationSpec()

    @property
    def frame_count(self) -> int:
        return max(1, round(self.duration_s * self.frame_rate))


def scenario_names() -> tuple[str, ...]:
    """Return the names of the built-in scenarios, the default one first, the others sorted."""
    names = (name for name in _built_in() if name[0] != "_")
    return tuple(sorted(names, key=lambda name: (name != "lab", name)))


def load_scenario(name: str) -> Scenario:
    """Load a built-in scenario by its name in any case, or a scenario file by its path.

    A file may extend a built-in one: ``based_on: NAME`` takes over every key that the file does
    not give itself; mappings are merged, lists replaced.

    Raises:
        ScenarioError: there is no such scenario, or one sentence on what is wrong in the file.
    """
    known = scenario_names()
    if name.lower() in known:
        name = name.lower()
        text = _folder().joinpath(f"{name}.yaml").read_text(encoding="utf-8")
        return scenario_from_text(text, name)
    path = Path(name)
    if path.suffix not in (".yaml", ".yml"):
        near = difflib.get_close_matches(name[:80].lower(), known, n=2, cutoff=0.0)
        raise ScenarioError(
            f"there is no scenario {name[:80]!r}; did you mean {' or '.join(near)}? Otherwise give "
            "the path of a .yaml file"
        )
    try:
        if not path.exists():
            raise ScenarioError(f"there is no scenario file {path}")
        text = read_text(path, "a scenario")
    except ScenarioError:
        raise
    except InputError as error:
        raise ScenarioError(str(error)) from None
    except (OSError, ValueError) as error:
        # The path is too long or contains a NUL character.
        why = getattr(error, "strerror", None) or error
        raise ScenarioError(f"the scenario file {name[:80]} cannot be read: {why}") from None
    return scenario_from_text(text, path.stem)


def scenario_from_text(text: str, name: str) -> Scenario:
    """Parse a scenario from YAML text.

    Raises:
        ScenarioError: one sentence that names the key and what would be right.
    """
    try:
        return Scenario.model_validate({"name": name, **_mapping(text, name, depth=0)})
    except ValidationError as error:
        raise ScenarioError(f"scenario {name}: {problem(error)}") from None


def _mapping(text: str, name: str, depth: int) -> dict[str, Any]:
    try:
        # Refuses YAML that would expand far beyond its text (aliases) before building anything.
        parse_text(text, name=f"scenario {name}", what="a scenario", form=_FORM)
        # A file of comments alone loads as None.
        data = yaml.safe_load(text) or {}
    except InputError as error:
        raise ScenarioError(str(error)) from None
    except (yaml.YAMLError, ValueError):
        # Raised for impossible dates, numbers of thousands of digits, and unknown tags.
        raise ScenarioError(
            f"scenario {name} contains a value that is not a plain number, text, true or false"
        ) from None
    base = data.pop("based_on", None)
    if base is None:
        return dict(data)
    if not isinstance(base, str) or base not in _built_in():
        raise ScenarioError(
            f"scenario {name}: based_on: there is no built-in scenario {str(base)[:80]!r}"
        )
    if depth > 5:
        raise ScenarioError(f"scenario {name}: based_on: the scenarios are based on each other")
    return _merged(_base(base, depth + 1), data)


@functools.cache
def _base(name: str, depth: int) -> dict[str, Any]:
    """Return the keys of a built-in file; cached for all scenarios that are based on it."""
    source = _folder().joinpath(f"{name}.yaml")
    return _mapping(source.read_text(encoding="utf-8"), name, depth)


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


def _built_in() -> set[str]:
    """Return the names of the built-in files, including those that only serve as a base."""
    files = (entry.name for entry in _folder().iterdir())
    return {file.removesuffix(".yaml") for file in files if file.endswith(".yaml")}


def _folder() -> Traversable:
    return resources.files("observer.simulation") / "scenarios"

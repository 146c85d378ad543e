"""All groups of parameters together: changed all or nothing, and described for forms and tables."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from functools import cache
from typing import Any, Self

from pydantic import ValidationError

from observer.errors import InputError, ParameterError
from observer.parameters.common import EgoMotionParameters, FeaturesParameters, StereoParameters
from observer.parameters.fields import ParameterValue, Stage
from observer.parameters.guard import GuardParameters
from observer.parameters.monocular import MonocularParameters
from observer.parameters.planar import (
    ClusteringParameters,
    FlowParameters,
    FramesParameters,
    MatchingParameters,
    MotionParameters,
    TrackingParameters,
)
from observer.parameters.rigid import (
    EvidenceParameters,
    KltTrackingParameters,
    ObstacleParameters,
)
from observer.parameters.surf_extra import surf_missing


class Parameters(Stage):
    """All parameters of the method, one group per stage."""

    ego_motion: EgoMotionParameters = EgoMotionParameters()
    klt_tracking: KltTrackingParameters = KltTrackingParameters()
    evidence: EvidenceParameters = EvidenceParameters()
    obstacles: ObstacleParameters = ObstacleParameters()
    monocular: MonocularParameters = MonocularParameters()
    stereo: StereoParameters = StereoParameters()
    frames: FramesParameters = FramesParameters()
    features: FeaturesParameters = FeaturesParameters()
    matching: MatchingParameters = MatchingParameters()
    flow: FlowParameters = FlowParameters()
    motion: MotionParameters = MotionParameters()
    clustering: ClusteringParameters = ClusteringParameters()
    tracking: TrackingParameters = TrackingParameters()
    guard: GuardParameters = GuardParameters()

    def flat(self) -> dict[str, ParameterValue]:
        """All values by dotted name, in the order of declaration."""
        return {
            f"{group}.{name}": value
            for group, values in self.model_dump().items()
            for name, value in values.items()
        }

    def changed(self, changes: Mapping[str, Any]) -> Self:
        """A copy with some values replaced, all or nothing.

        Args:
            changes: dotted name -> new value.

        Raises:
            ParameterError: naming every refused field and its range, or the extra that it needs
                and that is not installed; nothing is changed.
        """
        known = self.flat()
        problems = {
            name: f"there is no such parameter{_did_you_mean(name, known)}"
            for name in changes
            if name not in known
        }
        nested: dict[str, dict[str, Any]] = self.model_dump()
        for dotted, value in changes.items():
            if dotted in known:
                group, name = dotted.split(".")
                nested[group][name] = value
        try:
            result = type(self).model_validate(nested)
        except ValidationError as error:
            for detail in error.errors(include_url=False, include_context=False):
                dotted = ".".join(str(part) for part in detail["loc"][:2])
                problems[dotted] = describe_range(dotted)
        if nested["features"]["detector"] == "surf" and (missing := surf_missing()):
            problems["features.detector"] = missing
        if problems:
            raise ParameterError(problems)
        return result

    def difference(self, other: Parameters) -> dict[str, ParameterValue]:
        """The values of ``other`` that differ from these, by dotted name."""
        mine = self.flat()
        return {name: value for name, value in other.flat().items() if mine[name] != value}


def parameter_schema() -> list[dict[str, Any]]:
    """One entry per parameter, in order: what a form or a table needs to know of it.

    Keys: ``name, group, group_help, title, help, type`` (``number``, ``integer``, ``boolean``,
    ``choice``), ``unit, default, models`` (with which ``ego_motion.model`` it acts), and
    ``minimum, maximum, step`` or ``choices``.
    """
    return deepcopy(_declared())


@cache
def _declared() -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = []
    for group, group_field in Parameters.model_fields.items():
        stage = group_field.annotation
        assert isinstance(stage, type)
        assert issubclass(stage, Stage)
        for name, schema in stage.model_json_schema()["properties"].items():
            entry = {
                "name": f"{group}.{name}",
                "group": group,
                "group_help": " ".join((stage.__doc__ or "").split()),
                "title": schema["title"],
                "help": schema["description"],
                "unit": schema["unit"],
                "default": schema["default"],
                "models": schema.get("models", list(stage.models)),
            }
            if "enum" in schema:
                entry |= {"type": "choice", "choices": schema["enum"]}
            elif schema["type"] == "boolean":
                entry |= {"type": "boolean"}
            else:
                entry |= {
                    "type": schema["type"],
                    "minimum": schema["minimum"],
                    "maximum": schema["maximum"],
                    "step": schema["step"],
                }
            entries.append(entry)
    return entries


def describe_range(dotted: str) -> str:
    """One sentence that states which values a parameter takes."""
    for entry in _declared():
        if entry["name"] != dotted:
            continue
        if entry["type"] == "choice":
            return f"must be one of {', '.join(entry['choices'])}"
        if entry["type"] == "boolean":
            return "must be true or false"
        kind = "a whole number" if entry["type"] == "integer" else "a finite number"
        unit = f" {entry['unit']}" if entry["unit"] else ""
        return f"must be {kind} from {entry['minimum']:g} to {entry['maximum']:g}{unit}"
    raise InputError(f"there is no parameter named {dotted!r}")


def _did_you_mean(name: str, known: Mapping[str, Any]) -> str:
    import difflib

    near = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean {near[0]}?" if near else ""

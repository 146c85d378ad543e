"""Sets of parameter groups: changed all or nothing, and described for forms and tables."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping
from copy import deepcopy
from functools import cache
from typing import Any, Self

from pydantic import ValidationError

from observer.errors import InputError, ParameterError
from observer.parameters.fields import ParameterValue, Stage, helps
from observer.parameters.renamed import new_name, new_value

# Number of unknown names for which a suggestion is made, about a millisecond each.
_MOST_GUESSES = 5


class ParameterSet(Stage):
    """Base of a set of parameters; each field is a group, a ``Stage``."""

    def flat(self) -> dict[str, ParameterValue]:
        """Return all values by dotted name, in the order of declaration."""
        return {
            f"{group}.{name}": value
            for group, values in self.model_dump().items()
            for name, value in values.items()
        }

    def changed(self, changes: Mapping[str, Any]) -> Self:
        """Return a copy with some values replaced, all or nothing.

        Args:
            changes: dotted name -> new value.

        Raises:
            ParameterError: naming every refused field and its range, or the missing extra that it
                needs; nothing is changed.
        """
        known = self.flat()
        unknown = [name for name in changes if name not in known]
        problems = {
            name: _unknown(name, known if count < _MOST_GUESSES else ())
            for count, name in enumerate(unknown)
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
                problems[dotted] = self.describe_range(dotted) + _renamed_value(
                    dotted, detail["input"]
                )
        problems |= self._missing(nested)
        if problems:
            raise ParameterError(problems)
        return result

    @classmethod
    def _missing(cls, values: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
        """Return the values that need an extra that is not installed: dotted name -> sentence."""
        del values
        return {}

    def difference(self, other: ParameterSet) -> dict[str, ParameterValue]:
        """Return the values of ``other`` that differ from these, by dotted name."""
        mine = self.flat()
        return {name: value for name, value in other.flat().items() if mine[name] != value}

    @classmethod
    def own(cls, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the part of a flat map that belongs to a group of this set."""
        return {
            name: value for name, value in values.items() if name.split(".")[0] in cls.model_fields
        }

    @classmethod
    def declared(cls) -> list[dict[str, Any]]:
        """Return what a form or a table needs to know about each parameter, in order.

        Keys: ``name, group, group_help, title, help, type`` (``number``, ``integer``, ``boolean``,
        ``choice``), ``unit, default, models`` (values of ``ego_motion.model`` with which it affects
        observations), ``minimum, maximum, step`` or ``choices, labels`` (the names of the choices
        in forms), ``cloud`` (True) if with every model it affects the displayed dense cloud and
        disparity, and ``basic`` (True) if it is one of the eight that are shown first for each of
        its models.
        """
        return deepcopy(_declared(cls))

    @classmethod
    def declaration(cls, dotted: str) -> dict[str, Any]:
        """Return the entry of ``declared`` for one parameter.

        Raises:
            InputError: there is no parameter with that name.
        """
        entry = next((entry for entry in _declared(cls) if entry["name"] == dotted), None)
        if entry is None:
            raise InputError(f"there is no parameter named {dotted!r}")
        return deepcopy(entry)

    @classmethod
    def value_in_words(cls, dotted: str, value: str) -> str:
        """Return what forms call one of the values of a choice."""
        return str(cls.declaration(dotted)["labels"][value])

    @classmethod
    def describe_range(cls, dotted: str) -> str:
        """Return the part of a sentence that states which values a parameter accepts."""
        entry = cls.declaration(dotted)
        if entry["type"] == "choice":
            return f"must be one of {', '.join(entry['choices'])}"
        if entry["type"] == "boolean":
            return "must be true or false"
        kind = "a whole number" if entry["type"] == "integer" else "a finite number"
        unit = f" {entry['unit']}" if entry["unit"] else ""
        return f"must be {kind} from {entry['minimum']:g} to {entry['maximum']:g}{unit}"


@cache
def _declared(parameters: type[ParameterSet]) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = []
    for group, group_field in parameters.model_fields.items():
        stage = group_field.annotation
        assert isinstance(stage, type)
        assert issubclass(stage, Stage)
        for name, schema in stage.model_json_schema()["properties"].items():
            entry = {
                "name": f"{group}.{name}",
                "group": group,
                "group_help": " ".join((stage.__doc__ or "").split()),
                "title": schema["title"],
                "help": helps(stage.__module__)[stage.__name__, name],
                "unit": schema["unit"],
                "default": schema["default"],
                "models": schema.get("models", list(stage.models)),
            }
            if stage.cloud:
                entry["cloud"] = True
            if schema.get("basic"):
                entry["basic"] = True
            if "enum" in schema:
                entry |= {"type": "choice", "choices": schema["enum"], "labels": schema["labels"]}
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


def _unknown(name: str, known: Collection[str]) -> str:
    """Return what is wrong with a name, suggesting a similar one of the known names."""
    if (now := new_name(name)) != name:
        return f"has been renamed to {now}"
    near = difflib.get_close_matches(name, known, n=1)
    return "there is no such parameter" + (f"; did you mean {near[0]}?" if near else "")


def _renamed_value(dotted: str, value: Any) -> str:
    now = new_value(dotted, value)
    return f"; {value} has been renamed to {now}" if now is not value else ""

"""Declaring values of the contract, filling them and writing them as JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import fields
from enum import Enum
from functools import cache
from typing import Any, TypeVar

from pydantic import Field, TypeAdapter
from pydantic_core import PydanticSerializationError

Fact = TypeVar("Fact")

# Object of JSON whose content is declared elsewhere or free, and is not checked.
JsonObject = dict[str, Any]

# Maximum numbers of characters in what a person calls something, and in what opens a source.
LONGEST_NAME = 100
LONGEST_SPEC = 1000


def means(description: str) -> Any:
    """Return an annotation that describes a field in OpenAPI and the page's types, unchecked."""
    return Field(description=description)


def filled(fact: type[Fact], source: object, /, **given: Any) -> Fact:
    """Make a dataclass of the contract from an object with attributes of the same names.

    Args:
        given: fields that the object lacks, or that should differ from it.
    """
    names = {field.name for field in fields(fact)} - given.keys()  # type: ignore[arg-type]
    return fact(**{name: getattr(source, name) for name in names}, **given)


def of_plain(fact: type[Fact], plain: object, /) -> Fact:
    """Make a dataclass from plain values, as read from a file or another process.

    Raises:
        ValueError: they do not fit it.
    """
    checked: Fact = _adapter(fact).validate_python(plain)
    return checked


def known(fact: type[Fact], source: object | None, /) -> Fact | None:
    """Fill a dataclass as ``filled`` does; return None for None."""
    return None if source is None else filled(fact, source)


def word(member: Enum) -> Any:
    """Return the word that stands for an enumeration's member in messages."""
    return member.value


def json_text(value: Any) -> str:
    """Write one dataclass of the contract as JSON; non-finite numbers become null."""
    try:
        return _adapter(type(value)).dump_json(value).decode()
    except PydanticSerializationError:
        # Half a surrogate pair, in a robot's or a file's name, is not valid UTF-8.
        return json.dumps(plain(value), allow_nan=False)


def plain(value: Any) -> Any:
    """Return one dataclass of the contract as plain values, as JSON has them."""
    return _adapter(type(value)).dump_python(value, mode="json")


_adapter: Callable[[Any], TypeAdapter[Any]] = cache(TypeAdapter)

"""Pydantic's validation errors in words for end users.

Its own messages ("String should have at least 1 character") are for developers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

# Beginnings of messages that can directly follow the name of a value.
_PREDICATES = ("must ", "is ", "has ", "gives ", "appears ")
_SENTENCES: Mapping[str, str] = {
    "missing": "is missing",
    "extra_forbidden": "is not a known key",
    "string_type": "must be text",
    "string_too_short": "must have at least {min_length} characters",
    "string_too_long": "must have at most {max_length} characters",
    "string_pattern_mismatch": "has characters that are not allowed here",
    "int_type": "must be a whole number",
    "int_parsing": "must be a whole number",
    "int_from_float": "must be a whole number",
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "finite_number": "must be a finite number",
    "bool_type": "must be true or false",
    "bool_parsing": "must be true or false",
    "greater_than": "must be greater than {gt}",
    "greater_than_equal": "must be at least {ge}",
    "less_than": "must be less than {lt}",
    "less_than_equal": "must be at most {le}",
    "multiple_of": "must be a multiple of {multiple_of}",
    "literal_error": "must be {expected}",
    "enum": "must be {expected}",
    "too_short": "must have at least {min_length} entries",
    "too_long": "must have at most {max_length} entries",
    "list_type": "must be a list",
    "tuple_type": "must be a list",
    "dict_type": "must map names to values",
    "model_type": "must map names to values",
    "model_attributes_type": "must map names to values",
    "json_invalid": "is not valid JSON",
}


def validation_words(error: Mapping[str, Any]) -> str:
    """Return what is wrong with a value, as in ``must be at least 0.1``.

    Args:
        error: an entry of pydantic's ``ValidationError.errors``.
    """
    context = {name: _shown(value) for name, value in (error.get("ctx") or {}).items()}
    if error["type"] in ("string_too_short", "too_short") and context["min_length"] == "1":
        return "must not be empty"
    said = _SENTENCES.get(error["type"])
    if said is not None:
        return said.format_map(context)
    message = str(error["msg"]).removeprefix("Value error, ")
    message = re.sub(r"^(Input|Value|[A-Z][a-z]+) should ", "must ", message)
    return message[:1].lower() + message[1:]


def with_name(name: str, message: str) -> str:
    """Return a sentence that names the value: ``speed must be a number``, ``speed: no such file``.

    Args:
        name: of the value; may be empty.
    """
    if not name:
        return message
    return f"{name}{' ' if message.startswith(_PREDICATES) else ': '}{message}"


def _shown(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)

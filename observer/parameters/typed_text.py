"""Parameter values as people type them, on the command line or in a URL."""

from __future__ import annotations

import json

from observer.parameters.fields import ParameterValue


def typed_value(text: str) -> ParameterValue:
    """Convert numbers and true/false to their types; keep everything else as text."""
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        # Not JSON, or more digits or brackets than any value has.
        return text
    return value if isinstance(value, int | float | bool) else text

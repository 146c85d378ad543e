"""File names for the recipient of an answer, in any language."""

from __future__ import annotations

from typing import Literal
from urllib.parse import quote


def content_disposition(name: str, kind: Literal["attachment", "inline"] = "attachment") -> str:
    """Return the header's value, as RFC 6266 has it."""
    quoted = quote(name, safe=" ()[],;@!$&+=~")
    if quoted == name:
        return f'{kind}; filename="{name}"'
    return f"{kind}; filename*=utf-8''{quote(name)}"

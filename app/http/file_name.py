"""File names in the heads of answers and of uploads, in any language."""

from __future__ import annotations

import re
from typing import Literal
from urllib.parse import quote, unquote_to_bytes

# An extended value of RFC 8187, in one of the character sets that it names.
_EXTENDED = re.compile(
    r"""filename\*\s*=\s*"?(?P<set>utf-8|iso-8859-1)'[^']*'(?P<name>[^;"\s]+)""", re.IGNORECASE
)


def content_disposition(name: str, kind: Literal["attachment", "inline"] = "attachment") -> str:
    """Return the header's value, as RFC 6266 has it."""
    quoted = quote(name, safe=" ()[],;@!$&+=~")
    if quoted == name:
        return f'{kind}; filename="{name}"'
    return f"{kind}; filename*=utf-8''{quote(name)}"


def encoded_name(disposition: str) -> str | None:
    """Return the name that a Content-Disposition gives as ``filename*``; None without any."""
    found = _EXTENDED.search(disposition)
    if found is None:
        return None
    return unquote_to_bytes(found["name"]).decode(found["set"], errors="replace")

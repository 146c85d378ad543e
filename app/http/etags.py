"""Conditional requests: whether a client has the content that an ETag names."""

from __future__ import annotations

import re

from starlette.datastructures import Headers

# RFC 9110, 8.8.3: any character but the quote, so a tag may contain a comma.
_TAG = re.compile(r'(?:W/)?("[^"]*")')


def has_already(headers: Headers, tag: str) -> bool:
    """Return true if ``If-None-Match`` names this ETag, weak or strong, or any (RFC 9110, 13.1.2).

    Args:
        headers: of the request. tag: of the present content, quotes included.
    """
    asked = ",".join(headers.getlist("if-none-match"))
    return asked.strip() == "*" or tag.removeprefix("W/") in _TAG.findall(asked)

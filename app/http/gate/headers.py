"""What every answer says to the browser about what it may do."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Iterable

# frame-src: the viewer's page. img-src blob: live images; data: icons in style sheets.
PANEL_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; font-src 'self'; frame-src 'self'; manifest-src 'self'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'self'"
)
# viser's client is one file with everything inline; this is the least that lets it render without
# errors (its sorter of splats, a WebAssembly module, makes functions of text when it starts).
VIEWER_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob: data:; "
    "worker-src blob: data:; style-src 'unsafe-inline'; img-src blob: data:; font-src data:; "
    "connect-src 'self' data: blob:; frame-ancestors 'self'"
)
# Swagger UI writes style attributes.
DOCS_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self'"
)
# A report's drawings bring style attributes; it has no script and asks for nothing.
REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
_COMMON = (
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"SAMEORIGIN"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"permissions-policy", b"camera=(), microphone=(), geolocation=(), payment=(), usb=()"),
)
_UNLESS_SET = (
    (b"content-security-policy", PANEL_POLICY.encode()),
    (b"referrer-policy", b"no-referrer"),
    # Nothing of a session stays in a shared cache or on the disk unless the answer says so.
    (b"cache-control", b"no-store"),
)

RawHeaders = list[tuple[bytes, bytes]]


def secured(headers: Iterable[tuple[bytes, bytes]]) -> RawHeaders:
    """An answer's headers with what protects the browser; the answer's own policy stays."""
    result = [(name.lower(), value) for name, value in headers]
    present = {name for name, _ in result}
    result.extend(_COMMON)
    result.extend((name, value) for name, value in _UNLESS_SET if name not in present)
    return result


def page_policy(html: str) -> str:
    """The policy of a page that brings its styles and scripts within itself: these by hash only."""
    styles = " ".join(_hashes(html, "style")) or "'none'"
    scripts = " ".join(_hashes(html, "script")) or "'none'"
    return (
        f"default-src 'none'; script-src {scripts}; style-src {styles}; img-src data:; "
        "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'self'"
    )


def _hashes(html: str, element: str) -> list[str]:
    blocks = re.findall(rf"<{element}\b[^>]*>(.*?)</{element}>", html, re.DOTALL | re.IGNORECASE)
    return [
        "'sha256-" + base64.b64encode(hashlib.sha256(block.encode()).digest()).decode() + "'"
        for block in blocks
        if block
    ]

"""Security headers of every reply: what the browser allows it to do."""

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
# viser's client is one file with everything inline, beside which our own scripts are loaded. This
# is the strictest policy that lets it render without errors (its splat sorter, a WebAssembly
# module, compiles functions from text at start). sandbox: it has an origin of its own, so it cannot
# do what the panel may, and its drawing does not block the panel: browsers give it a process.
VIEWER_POLICY = (
    "sandbox allow-scripts; default-src 'none'; "
    "script-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; "
    "worker-src blob: data:; style-src 'unsafe-inline'; img-src blob: data:; font-src data:; "
    "connect-src 'self' data: blob:; frame-ancestors 'self'"
)
# Swagger UI writes style attributes.
DOCS_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self'"
)
# For pages of the documentation; Material for MkDocs writes style attributes and runs its search in
# a worker.
_HELP_POLICY = (
    "default-src 'none'; script-src 'self' {scripts}; worker-src 'self'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
# A report's drawings use style attributes; it has no script and loads nothing.
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
    # No reply of a session stays in a shared cache or on the disk unless it says so.
    (b"cache-control", b"no-store"),
)

RawHeaders = list[tuple[bytes, bytes]]


def secured(headers: Iterable[tuple[bytes, bytes]]) -> RawHeaders:
    """Add the protective headers to a reply's own; keep the reply's own policy."""
    result = [(name.lower(), value) for name, value in headers]
    present = {name for name, _ in result}
    result.extend(_COMMON)
    result.extend((name, value) for name, value in _UNLESS_SET if name not in present)
    return result


def page_policy(html: str) -> str:
    """Return the policy of a page with inline styles and scripts: it allows these by hash only."""
    styles = " ".join(_hashes(html, "style")) or "'none'"
    scripts = " ".join(_hashes(html, "script")) or "'none'"
    return (
        f"default-src 'none'; script-src {scripts}; style-src {styles}; img-src data:; "
        "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'self'"
    )


def help_policy(html: str) -> str:
    """Return the policy of a page of the documentation: no inline script but its own."""
    return _HELP_POLICY.format(scripts=" ".join(dict.fromkeys(_hashes(html, "script"))))


def _hashes(html: str, element: str) -> list[str]:
    blocks = re.findall(rf"<{element}\b[^>]*>(.*?)</{element}>", html, re.DOTALL | re.IGNORECASE)
    return [
        "'sha256-" + base64.b64encode(hashlib.sha256(block.encode()).digest()).decode() + "'"
        for block in blocks
        if block
    ]

"""Findings of axe-core, which checks pages against WCAG, in the current state of a page."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Page

_SCRIPT = Path(__file__).resolve().parents[2] / "static" / "node_modules" / "axe-core/axe.min.js"
_LIBRARY = "() => window.axe === undefined"
# All rules of WCAG 2.0 to 2.2, levels A and AA, and best practices.
_RULES = {
    "type": "tag",
    "values": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"],
}
_COLOURS = {"type": "rule", "values": ["color-contrast"]}
# Findings of any severity. The content of frames is viser's; the frame itself is the page's.
_RUN = """async (runOnly) => {
  const options = { runOnly, resultTypes: ["violations"], iframes: false };
  const { violations, passes } = await axe.run(document, options);
  const found = violations.flatMap(({ id, impact, help, nodes }) =>
    nodes.map(({ target, html, any, all, none }) => [
      `${id} (${impact}): ${help}`,
      target.join(" "),
      html.slice(0, 160),
      [...any, ...all, ...none].map(({ message }) => message).join("; "),
    ].join("\\n    ")));
  return [passes.length, found];
}"""
# Far fewer passed rules would mean that it looked at an empty page.
_LEAST_PASSED = 15


def findings(page: Page, *, colours: bool = False) -> list[str]:
    """Return what axe finds in the current state of a page, a paragraph for each faulty element.

    Args:
        colours: whether only the contrast of texts is checked.
    """
    if page.evaluate(_LIBRARY):
        if not _SCRIPT.is_file():
            pytest.fail(
                "axe-core is missing: .venv/bin/python tools/packaging/frontend.py development"
            )
        # Not as an element of the page, whose content security policy forbids such scripts.
        page.evaluate(_SCRIPT.read_text(encoding="utf-8"))
    passed, found = page.evaluate(_RUN, _COLOURS if colours else _RULES)
    assert passed >= (1 if colours else _LEAST_PASSED), (
        f"axe looked at nothing: {passed} rules passed"
    )
    return list(found)

"""A user of the page without a mouse."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

# The focused element: its accessible name, an identity, whether there is a focus at all, and
# whether it is visible.
_FOCUS = """() => {
  const e = document.activeElement;
  if (!e || e === document.body) return ["", "", false, false];
  e.dataset.met ??= String(window.met = (window.met ?? 0) + 1);
  const name = e.getAttribute("aria-label") ?? (e.labels?.[0] ?? e).textContent.trim();
  const shown = e.type === "checkbox" ? [e, e.closest("label")] : [e];
  const outlined = shown.some((s) => s && getComputedStyle(s).outlineStyle !== "none");
  const box = e.getBoundingClientRect();
  const inside = box.bottom > 0 && box.top < innerHeight && box.right > 0 && box.left < innerWidth;
  return [name, e.dataset.met, true, e.tagName === "IFRAME" || (outlined && inside)];
}"""


class KeyboardUser:
    """A user without a mouse, whose focus must never be lost or invisible."""

    def __init__(self, page: Page) -> None:
        self._page = page

    def focus(self) -> tuple[str, str]:
        """Return name and identity of the focused element; fail if none or hidden."""
        name, identity, held, seen = self._page.evaluate(_FOCUS)
        assert held, "the focus is lost"
        assert seen, f"the focus is not seen: {name!r}"
        return name, identity

    def press(self, *keys: str) -> None:
        for key in keys:
            self._page.keyboard.press(key)

    def go(self, name: str, key: str = "Tab", most: int = 40) -> None:
        """Press a key until the element of this name has the focus."""
        passed = []
        for _ in range(most):
            self.press(key)
            here, _ = self.focus()
            passed.append(here[:60])
            if here.startswith(name):
                return
        pytest.fail(f"{name!r} was not reached by {key}, but {passed}")

    def enter(self, text: str) -> None:
        """Overwrite the text of a field."""
        self.press("Control+a")
        self._page.keyboard.type(text)

    def open_calibrations(self) -> None:
        """Go to the side panel by the skip link, then to its tab, whose content is next."""
        # Wait for the last part of the page to load, so that the tab's buttons are there.
        self._page.wait_for_function("() => customElements.get('observer-calibration-wizard')")
        self.go("Skip to settings")
        self.press("Enter")
        self.go("Parameters")
        self.go("Calibration", "ArrowRight", most=2)
        expect(self._page.get_by_role("button", name="Calibrate cameras")).to_be_visible()

    def focus_is_on(self, name: str) -> None:
        """Wait until the focus has moved there by itself."""
        self._page.wait_for_function(
            "(name) => document.activeElement.textContent.trim().startsWith(name)", arg=name
        )
        self.focus()

"""The stand-in for the calibration's worker."""

from __future__ import annotations

from typing import Any

import pytest

from app.server.calibrating import computation, manager

from .capturing import Computing


@pytest.fixture
def computing(monkeypatch: pytest.MonkeyPatch, calibration_yaml: Any) -> Computing:
    made = Computing(calibration_yaml())
    monkeypatch.setattr(computation, "work", made)
    # The tests' archives are not real ones.
    monkeypatch.setattr(manager, "check_archive", lambda _: None)
    return made

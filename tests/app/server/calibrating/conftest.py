"""The stand-in for the calibration's worker."""

from __future__ import annotations

from typing import Any

import pytest

from app.server.calibrating import session as calibration_desk

from .desk import Computing


@pytest.fixture
def computing(monkeypatch: pytest.MonkeyPatch, calibration_yaml: Any) -> Computing:
    made = Computing(calibration_yaml())
    monkeypatch.setattr(calibration_desk, "work", made)
    return made

"""Circumstances of a check, and what has changed since."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

from app.contract.parameters import ParameterValues
from app.contract.robots import CheckRecord
from app.server.rig.store import text_without_ports
from observer.rig.rig import Rig


@dataclass(frozen=True)
class Circumstances:
    """Conditions that the guard depends on.

    Attributes:
        software: versions by name. source: as shown to users.
        calibration: its id; None for the source's own. rig: its id, the same for rigs that
            differ only in the robots' ports.
        rig_yaml: the rig as its file holds it, without ports, which may contain keys.
        guard: its parameters by dotted name.
    """

    software: Mapping[str, str]
    source: str
    calibration: str | None
    rig: str
    rig_yaml: str
    guard: ParameterValues

    @staticmethod
    def of(
        *,
        software: Mapping[str, str],
        source: str,
        calibration: str | None,
        rig: Rig,
        guard: ParameterValues,
    ) -> Circumstances:
        """Return the circumstances for a rig."""
        text = text_without_ports(rig)
        return Circumstances(software, source, calibration, _id_of(text), text, dict(guard))

    def differences(self, before: Circumstances | CheckRecord) -> list[str]:
        """Describe the differences from earlier ones in words."""
        words = []
        if before.rig != self.rig:
            words.append("the rig")
        own = self.calibration is None and before.source != self.source
        if before.calibration != self.calibration or own:
            words.append("the calibration")
        if before.guard != self.guard:
            words.append("the guard's parameters")
        return words


def _id_of(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]

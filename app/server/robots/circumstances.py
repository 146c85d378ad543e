"""With what a check was made, and what of it is another by now."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from app.server.rig.store import text_without_ports
from observer.rig.rig import Rig


@dataclass(frozen=True)
class Circumstances:
    """What the guard goes by.

    Attributes:
        software: versions by name. source: as it is shown.
        calibration: its id; None: the source's own. rig: its id, the same for rigs that
            differ only in how the robots are reached.
        rig_yaml: the rig as its file holds it, without ports: they may hold keys.
        guard: its parameters by dotted name.
    """

    software: Mapping[str, str]
    source: str
    calibration: str | None
    rig: str
    rig_yaml: str
    guard: Mapping[str, Any]

    @staticmethod
    def of(
        *,
        software: Mapping[str, str],
        source: str,
        calibration: str | None,
        rig: Rig,
        guard: Mapping[str, Any],
    ) -> Circumstances:
        """Those with a rig."""
        text = text_without_ports(rig)
        return Circumstances(software, source, calibration, _id_of(text), text, dict(guard))

    def facts(self) -> dict[str, Any]:
        """As plain values, for JSON."""
        return asdict(self)

    def differences(self, before: Mapping[str, Any]) -> list[str]:
        """What is another than in a record, in words; what a record does not have is another."""
        words = []
        if before.get("rig") != self.rig:
            words.append("the rig")
        own = self.calibration is None and before.get("source") != self.source
        if before.get("calibration", "") != self.calibration or own:
            words.append("the calibration")
        if before.get("guard") != dict(self.guard):
            words.append("the guard's parameters")
        return words


def _id_of(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]

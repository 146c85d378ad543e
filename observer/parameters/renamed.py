"""Former names of parameters and values: refused when given, translated when read from storage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_GROUPS = {"following": "klt_tracking", "one_camera": "monocular"}
_NAMES = {
    "following.growth_noise": "klt_tracking.scale_change_noise",
    "evidence.stretch": "evidence.distortion_sigma",
    "ego_motion.shared_error": "ego_motion.noise_correlation",
    "evidence.shared_error": "evidence.noise_correlation",
    "obstacles.shared_error": "obstacles.noise_correlation",
    "motion.shared_error": "motion.noise_correlation",
}
_VALUES = {("ego_motion.model", "one_camera"): "monocular"}


def new_name(name: str) -> str:
    """Return the current name of a renamed parameter; any other name unchanged."""
    group, dot, field = name.partition(".")
    return _NAMES.get(name, f"{_GROUPS.get(group, group)}{dot}{field}")


def new_value(name: str, value: Any) -> Any:
    """Return the current form of a renamed value of ``name``; any other value unchanged."""
    return _VALUES.get((name, value), value) if isinstance(value, str) else value


def translated(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return stored values, dotted name -> value, under their current names."""
    return {(now := new_name(name)): new_value(now, value) for name, value in values.items()}

"""Named sets of parameters: the best known ones, and the method exactly as published."""

from __future__ import annotations

from observer.errors import InputError
from observer.parameters.fields import ParameterValue
from observer.parameters.groups import Parameters

# The declared defaults are the best we have; the published method differs in these.
_PRESETS: dict[str, dict[str, ParameterValue]] = {
    "paper": {
        "ego_motion.model": "affine",
        "ego_motion.ransac_threshold_px": 1.5,
        "frames.interval": 1,
        "features.detector": "fast",
        "matching.method": "descriptor",
        "flow.residual_threshold_px": 1.5,
        "flow.min_texture": 0.3,
        "flow.match_brightness": False,
        "motion.min_significance": 0.0,
    },
    "default": {},
}
PRESET_HELP: dict[str, str] = {
    "paper": "The published method: FAST corners, descriptor matching, affine RANSAC, optical flow "
    "of the warped image, velocity from raw displacement.",
    "default": "3D motion: points tracked in both cameras, ego-motion with six degrees of freedom, "
    "evidence pooled over neighbours and time, obstacles tracked as bodies.",
}


def preset(name: str) -> Parameters:
    """Return the parameters of a named preset.

    Raises:
        InputError: there is no such preset; the sentence lists the existing ones.
    """
    if name not in _PRESETS:
        raise InputError(f"there is no preset {name!r}; available are: {', '.join(_PRESETS)}")
    return Parameters().changed(_PRESETS[name])


def preset_names() -> tuple[str, ...]:
    """Return the names of the presets, ``default`` last."""
    return tuple(_PRESETS)

"""Timed velocities for robots, as data.

``library`` has those that come with the project, ``programme_file`` reads and writes them as YAML,
``playing`` says how fast each robot shall drive at an instant.
"""

from observer.motion_profiles.library import load_programme, programme_names, read_programme
from observer.motion_profiles.playing import duration_s, progress_at, velocity_at
from observer.motion_profiles.profile import Programme, Step
from observer.motion_profiles.profile_file import programme_from_text, programme_text

__all__ = [
    "Programme",
    "Step",
    "duration_s",
    "load_programme",
    "programme_from_text",
    "programme_names",
    "programme_text",
    "progress_at",
    "read_programme",
    "velocity_at",
]

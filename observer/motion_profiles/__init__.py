"""Timed velocities for robots, as data.

``library`` holds those that come with the project, ``profile_file`` reads and writes them as YAML,
``playing`` samples the velocity of each robot at an instant. Users know them as *programmes*.
"""

from observer.motion_profiles.library import load_profile, profile_names, read_profile
from observer.motion_profiles.playing import duration_s, progress_at, velocity_at
from observer.motion_profiles.profile import MotionProfile, Step
from observer.motion_profiles.profile_file import profile_from_text, profile_text

__all__ = [
    "MotionProfile",
    "Step",
    "duration_s",
    "load_profile",
    "profile_from_text",
    "profile_names",
    "profile_text",
    "progress_at",
    "read_profile",
    "velocity_at",
]

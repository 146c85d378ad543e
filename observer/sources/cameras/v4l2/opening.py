"""Errors of a video device as one sentence that says what is wrong and what to do."""

from __future__ import annotations

import errno
from pathlib import Path

from observer.sources.cameras.device_files import (
    User,
    holders,
    in_words,
    permission_advice,
    shown_path,
)

_MACHINE = Path("/")


def why_not(file: Path, error: OSError, root: Path = _MACHINE, user: User | None = None) -> str:
    """Return one sentence for an error of a device file: what is wrong and what to do."""
    shown = shown_path(file, root)
    if error.errno in (errno.EACCES, errno.EPERM):
        try:
            return permission_advice(file, root, user)
        except OSError:
            return f"{shown} may not be used by you ({error.strerror})"
    if error.errno == errno.ENOENT:
        return f"there is no {shown}; plug the camera in, or see dynamic-observer doctor for a list"
    if error.errno == errno.EBUSY:
        who = in_words(holders(file, root))
        advice = "close it" if who else f"sudo fuser -v {shown} tells which"
        return f"{shown} is in use by {who or 'another program'}; {advice}"
    if error.errno in (errno.ENODEV, errno.ENXIO, errno.EIO):
        return f"{shown} does not answer ({error.strerror}); unplug the camera and plug it in again"
    if error.errno in (errno.ENOTTY, errno.EINVAL):
        return f"{shown} is no video device; name one such as /dev/video0"
    return f"{shown} cannot be used ({error.strerror or error})"

"""Opening of a video device, or one sentence that says why not and what to do."""

from __future__ import annotations

import errno
from pathlib import Path

from observer.errors import SourceError
from observer.sources.cameras.device_files import (
    User,
    holders,
    in_words,
    permission_advice,
    shown_path,
)
from observer.sources.cameras.v4l2.device import DeviceAccess, LinuxAccess, V4l2Device

_MACHINE = Path("/")


def open_device(
    path: str | Path, *, root: Path = _MACHINE, access: DeviceAccess | None = None
) -> V4l2Device:
    """Open a device file for questions and settings; images may flow elsewhere meanwhile.

    Args:
        path: as it is called on the machine, as in ``/dev/video0`` or ``/dev/v4l/by-path/...``.
        root: the machine's file system. access: its kernel; None for this one.

    Raises:
        SourceError: it cannot be opened.
    """
    file = root / str(path).lstrip("/")
    try:
        return V4l2Device(file, access or LinuxAccess())
    except OSError as error:
        raise SourceError(why_not(file, error, root)) from error


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

"""Permissions and errors of device files, and the processes that have them open, with advice."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

# Root of the file system of this machine; tests have machines of their own.
MACHINE = Path("/")

# A server starts an engine, which starts a process for each camera.
_MOST_GENERATIONS = 6


@dataclass(frozen=True)
class User:
    """The current user, as the permissions of device files see them.

    Attributes:
        name: the account's; empty where it has none.
        groups: IDs of the groups that this process actually has.
    """

    name: str
    groups: frozenset[int]


@dataclass(frozen=True)
class Holder:
    """A process that has a device file open."""

    process: int
    name: str


def current_user() -> User:
    """Return the user of this process."""
    import pwd  # not on every system that can read recordings

    try:
        name = pwd.getpwuid(os.getuid()).pw_name
    except KeyError:
        name = ""
    return User(name, frozenset({*os.getgroups(), os.getgid()}))


def permission_advice(path: Path, root: Path = MACHINE, user: User | None = None) -> str:
    """Return one sentence: why the device file may not be used, and what makes it usable.

    Args:
        path: the file as it is reached, below ``root``.
        root: the machine's file system; its ``etc/group`` names the groups.
        user: None for the user of this process.
    """
    shown = shown_path(path, root)
    number = path.stat().st_gid
    group, members = _groups(root).get(number, (None, ()))
    who = user or current_user()
    if group == "root" or (group is None and number == 0):
        return (
            f"only root may use {shown}; a udev rule can assign it to a group, see docker/README.md"
        )
    if group is None:
        return (
            f"you have no permission to use {shown}; it belongs to group {number}, which has no "
            f"name here; in a container add --group-add {number}"
        )
    if number in who.groups:
        return (
            f"you have no permission to use {shown} although you are in its group {group}; let the "
            f"group read and write it: sudo chmod g+rw {shown}"
        )
    if who.name and who.name in members:
        return (
            f"you have no permission to use {shown} yet: you were added to the group {group} after "
            f"you signed in; sign out and in again (or: newgrp {group})"
        )
    return (
        f"only the group {group} may use {shown}; join it, then sign out and in again: sudo "
        f"usermod -aG {group} {who.name or '$USER'}"
    )


def holders(path: Path, root: Path = MACHINE) -> tuple[Holder, ...]:
    """Return the other processes that have the file open, as far as this user may see them.

    Processes that this one started do not count: what they hold is ours.
    """
    wanted = shown_path(path, root)
    found = []
    for folder in sorted(root.glob("proc/[0-9]*"), key=lambda folder: int(folder.name)):
        if wanted in _open_files(folder) and not _is_ours(int(folder.name), root):
            found.append(Holder(int(folder.name), text_in(folder / "comm") or "a process"))
    return tuple(found)


def why_not(file: Path, error: OSError, root: Path = MACHINE, user: User | None = None) -> str:
    """Return one sentence for an error of a device file: what is wrong and what to do."""
    shown = shown_path(file, root)
    if error.errno in (errno.EACCES, errno.EPERM):
        try:
            return permission_advice(file, root, user)
        except OSError:
            return f"you have no permission to use {shown} ({error.strerror})"
    if error.errno == errno.ENOENT:
        return f"there is no {shown}; plug the camera in, or run dynamic-observer doctor for a list"
    if error.errno == errno.EBUSY:
        who = in_words(holders(file, root))
        advice = "close it" if who else f"sudo fuser -v {shown} shows which"
        return f"{shown} is in use by {who or 'another program'}; {advice}"
    if error.errno in (errno.ENODEV, errno.ENXIO, errno.EIO):
        return f"{shown} does not answer ({error.strerror}); unplug the camera and plug it in again"
    if error.errno in (errno.ENOTTY, errno.EINVAL):
        return f"{shown} is not a video device; name one such as /dev/video0"
    return f"{shown} cannot be used ({error.strerror or error})"


def in_words(holders: Iterable[Holder]) -> str:
    """Return names and numbers of processes for a sentence; empty without any."""
    return ", ".join(f"{each.name} (process {each.process})" for each in holders)


def shown_path(path: Path, root: Path = MACHINE) -> str:
    """Return the path's name on the machine whose file system is at ``root``."""
    return f"/{path.relative_to(root)}"


def text_in(file: Path) -> str | None:
    """Return the text of a small kernel file; None where it cannot be read."""
    try:
        return file.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return None


def _open_files(folder: Path) -> Iterator[str]:
    # Processes may end meanwhile, and most of other users' cannot be read.
    try:
        links = list((folder / "fd").iterdir())
    except OSError:
        return
    for link in links:
        try:
            yield os.readlink(link)
        except OSError:
            continue


def _is_ours(process: int, root: Path) -> bool:
    """Return whether it is this process or a descendant of it."""
    for _ in range(_MOST_GENERATIONS):
        if process == os.getpid():
            return True
        # The name, in parentheses, may contain anything; the parent is the second word after it.
        words = (text_in(root / "proc" / str(process) / "stat") or "").rpartition(")")[2].split()
        if len(words) < 2 or not words[1].isdecimal() or words[1] == "0":
            return False
        process = int(words[1])
    return False


def _groups(root: Path) -> dict[int, tuple[str, tuple[str, ...]]]:
    """Return the groups: number -> name and members."""
    found: dict[int, tuple[str, tuple[str, ...]]] = {}
    for line in (text_in(root / "etc" / "group") or "").splitlines():
        parts = line.split(":")
        if len(parts) >= 4 and parts[2].isdecimal():
            members = tuple(name for name in parts[3].split(",") if name)
            found[int(parts[2])] = (parts[0], members)
    return found

"""Cameras named by a source's text; passwords in it are never shown."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qsl, urlencode, urlsplit, urlunsplit

from observer.errors import SourceError
from observer.sources.cameras.settings import CameraSettings, parse_settings

BY_PATH = Path("/dev/v4l/by-path")
_NETWORK_SCHEMES = ("rtsp", "rtsps", "http", "https")
# One camera that shows both images side by side: the left one in the left half, or in the right.
_SIDE_BY_SIDE, _SWAPPED = "sbs:", "sbs_swapped:"
# A comma may be part of an address; one that separates two addresses precedes a scheme.
_BETWEEN_URLS = re.compile(r",\s*(?=(?:rtsps?|https?)://)", re.IGNORECASE)
# Cheap network cameras take user name and password as parameters of their URL.
_SECRET_KEY = re.compile(r"user|usr|login|pass|pwd|pw$|token|secret|auth|key", re.IGNORECASE)


@dataclass(frozen=True)
class CameraTarget:
    """One camera to open.

    Attributes:
        address: path of the device or URL, password included; handed to the camera's own process
            and shown to nobody.
        name: for finding it again and for display: its by-path name where there is one; for a
            URL, the URL without user and password.
        network: True for a URL.
    """

    address: str
    name: str
    network: bool

    def __repr__(self) -> str:
        # The address may hold a password, and a repr ends up in logs.
        return f"CameraTarget({self.name!r})"


@dataclass(frozen=True)
class CamerasSpec:
    """Cameras and settings that a source's text asks for.

    Attributes:
        text: the source's text with users and passwords left out.
        targets: left and right, or one that shows both images.
        settings: for each of them.
        swapped: whether the left image is in the right half of one that shows both.
    """

    text: str
    targets: tuple[CameraTarget, ...]
    settings: CameraSettings
    swapped: bool = False

    @property
    def network(self) -> bool:
        """True where at least one image comes over the network."""
        return any(target.network for target in self.targets)


def parse_devices(rest: str, by_path: Path = BY_PATH) -> CamerasSpec:
    """Read what follows ``camera:``, as in ``0,1?size=640x480`` or ``sbs:/dev/v4l/by-path/...``.

    Raises:
        SourceError: one sentence that says what is wrong and what would be right.
    """
    names, _, query = rest.partition("?")
    settings = parse_settings(query)
    targets: tuple[CameraTarget, ...]
    both, swapped = _side_by_side(names)
    if both is not None:
        targets = (_device(both, by_path),)
    else:
        parts = [part.strip() for part in names.split(",")]
        if len(parts) != 2:
            raise SourceError(
                "camera: takes two devices separated by a comma, as in camera:0,1, or one "
                f"side-by-side device, as in camera:sbs:0, not {names[:80]!r}"
            )
        targets = (_device(parts[0], by_path), _device(parts[1], by_path))
        if Path(targets[0].address).resolve() == Path(targets[1].address).resolve():
            raise SourceError(
                f"left and right are the same camera, {targets[0].name}; name two "
                "different ones, or a side-by-side camera as in camera:sbs:0"
            )
    return CamerasSpec(f"camera:{rest}", targets, settings, swapped)


def parse_urls(text: str) -> CamerasSpec:
    """Read ``rtsp://...,http://...`` or ``sbs:rtsp://...``.

    Raises:
        SourceError: one sentence that says what is wrong and what would be right.
    """
    both, swapped = _side_by_side(text)
    side_by_side = both is not None
    urls = _BETWEEN_URLS.split(text if both is None else both)
    targets = tuple(_url(url.strip()) for url in urls)
    names = ",".join(target.name for target in targets)
    if side_by_side and len(targets) != 1:
        raise SourceError(f"sbs: takes the address of one side-by-side camera, not {names[:200]}")
    if not side_by_side and len(targets) != 2:
        raise SourceError(
            "give two network cameras, as in rtsp://LEFT,rtsp://RIGHT, or one side-by-side camera, "
            f"as in sbs:rtsp://BOTH, not {names[:200]}"
        )
    if len({target.address for target in targets}) != len(targets):
        raise SourceError(
            f"left and right are the same camera, {targets[0].name}; name two different ones"
        )
    prefix = "" if not side_by_side else _SWAPPED if swapped else _SIDE_BY_SIDE
    return CamerasSpec(f"{prefix}{names}", targets, CameraSettings(), swapped)


def swapped_spec(text: str) -> str:
    """Return the source's text with left and right exchanged, passwords kept.

    Args:
        text: as ``observer.opening.open_source`` takes it.

    Raises:
        SourceError: it names no live cameras.
    """
    if text.lower().startswith("camera:"):
        names, question, query = text[len("camera:") :].partition("?")
        return f"camera:{_swapped_names(names, names.split(','))}{question}{query}"
    both, _ = _side_by_side(text)
    if both is None and not text.lower().startswith(_NETWORK_SCHEMES):
        raise SourceError(
            "only live cameras can be swapped; name left and right the other way round"
        )
    return _swapped_names(text, _BETWEEN_URLS.split(text))


def _swapped_names(text: str, names: list[str]) -> str:
    both, swapped = _side_by_side(text)
    if both is not None:
        return f"{_SIDE_BY_SIDE if swapped else _SWAPPED}{both}"
    return ",".join(name.strip() for name in reversed(names))


def _side_by_side(text: str) -> tuple[str | None, bool]:
    """Return the camera that shows both images, None without one, and whether they are swapped."""
    for prefix, swapped in ((_SIDE_BY_SIDE, False), (_SWAPPED, True)):
        if text.lower().startswith(prefix):
            return text[len(prefix) :], swapped
    return None, False


def without_password(url: str) -> str:
    """Return the URL without user, password and parameters that look like these."""
    parts = urlsplit(url)
    query = parts.query
    pairs = parse_qsl(query, keep_blank_values=True)
    if any(_SECRET_KEY.search(key) for key, _ in pairs):
        query = urlencode([(key, value) for key, value in pairs if not _SECRET_KEY.search(key)])
    # If the scheme was typed twice, the user ends up in the path.
    path = re.sub(r"//[^/]*@", "//", parts.path)
    return urlunsplit((parts.scheme, parts.netloc.rpartition("@")[2], path, query, parts.fragment))


def _device(text: str, by_path: Path) -> CameraTarget:
    text = text.strip()
    if re.fullmatch(r"[0-9]{1,9}", text):
        path = f"/dev/video{int(text)}"
    elif text.startswith("/") and "\0" not in text:
        path = text
    else:
        raise SourceError(
            f"{text[:80]!r} is not a camera; use its number, as in camera:0,1, or its path below "
            f"{BY_PATH}"
        )
    return CameraTarget(path, _lasting_name(path, by_path), network=False)


def _lasting_name(path: str, by_path: Path) -> str:
    """Return the by-path name of the device, which stays the same at the same port."""
    if Path(path).parent == by_path:
        return path
    try:
        links = sorted(by_path.iterdir())
    except OSError:
        return path
    real = Path(path).resolve()
    return next((str(link) for link in links if link.resolve() == real), path)


def _url(url: str) -> CameraTarget:
    try:
        parts = urlsplit(url)
        host = parts.hostname
        _ = parts.port  # read only to be checked
        name = without_password(url)
    except ValueError:
        host = None
    if not host or parts.scheme.lower() not in _NETWORK_SCHEMES:
        raise SourceError(
            "a network camera address is incomplete; use rtsp://HOST/PATH or http://HOST/PATH for "
            "each"
        )
    return CameraTarget(url, name, network=True)

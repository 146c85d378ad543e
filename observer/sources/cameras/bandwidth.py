"""Whether what two open cameras send fits on the USB bus they share."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from observer.sources.cameras.usb import usb_place

# A USB 2 bus carries 60 MB/s, of which 80 % may be reserved for cameras, and each reserves more
# than it sends: the next larger step of those that it offers.
_TOO_MUCH_BYTES_PER_S = 30e6
_USB_2_MBIT = 480.0
_COMPRESSED = frozenset({"MJPG", "JPEG", "H264", "HEVC"})
# What MJPG makes of 2 bytes a pixel where there is much texture.
_COMPRESSION = 6.0


def bandwidth_hints(
    devices: Sequence[str],
    *,
    width: int,
    height: int,
    rate: float,
    pixel_format: str | None,
    root: Path = Path("/"),
) -> tuple[str, ...]:
    """Sentences for the person who sets the cameras up; none where all is well.

    Args:
        devices: paths of both.
        width, height: of each image, pixels. rate: frames per second.
        pixel_format: four characters, None where unknown.
        root: the machine's file system.
    """
    places = [usb_place(_node(device, root), root) for device in devices]
    buses = {None if place is None else (place.controller, place.bus) for place in places}
    if len(buses) != 1 or None in buses:
        return ()
    if any(place and place.speed_mbit and place.speed_mbit > _USB_2_MBIT for place in places):
        return ()
    total = len(devices) * 2.0 * width * height * rate
    is_compressed = pixel_format in _COMPRESSED
    if is_compressed:
        total /= _COMPRESSION
    if total < _TOO_MUCH_BYTES_PER_S:
        return ()
    remedy = "take a lower size or rate" if is_compressed else "set format=MJPG or a lower size"
    return (
        f"both cameras share one USB 2 bus and send about {total / 1e6:.0f} MB/s, which may be "
        f"too much for it; {remedy}, or plug one of them into a port of another controller",
    )


def _node(device: str, root: Path) -> str:
    return Path(os.path.realpath(root / device.lstrip("/"))).name

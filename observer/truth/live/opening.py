"""Opens live motion capture from a spec."""

from __future__ import annotations

import re
import time
from collections.abc import Callable

from observer.errors import TruthError
from observer.truth.live.heard import LiveCapture
from observer.truth.live.vicon_stream import DEFAULT_PORT as VICON_PORT
from observer.truth.live.vrpn import DEFAULT_PORT as VRPN_PORT

VRPN, VICON_UDP = "vrpn:", "vicon-udp:"
_FORMS = (
    "live motion capture is given as vrpn:HOST, vrpn:HOST:PORT/NAME,NAME or vicon-udp:PORT, for "
    f"example vicon-udp:{VICON_PORT}"
)
_VRPN = re.compile(
    r"(?P<host>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9_.-]+)(?::(?P<port>\d{1,5}))?(?:/(?P<names>.*))?"
)


def check_live(spec: str) -> None:
    """Check that a text names live motion capture, without opening anything.

    Raises:
        TruthError: it does not.
    """
    _parse(spec)


def open_live_truth(spec: str, *, clock: Callable[[], float] = time.monotonic) -> LiveCapture:
    """Open live motion capture, which connects by itself from now on.

    Args:
        spec: ``vrpn:HOST[:PORT][/NAME,NAME]`` (default port 3883; only these bodies, or all) or
            ``vicon-udp:PORT``.
        clock: the host's monotonic clock, seconds.

    Raises:
        TruthError: the text names no live motion capture.
    """
    kind, host, port, names = _parse(spec)
    if kind == VRPN:
        from observer.truth.live.vrpn_client import VrpnCapture

        return VrpnCapture(host, port, names, spec=spec, clock=clock)
    from observer.truth.live.vicon_udp import ViconUdpCapture

    return ViconUdpCapture(port, spec=spec, clock=clock)


def _parse(spec: str) -> tuple[str, str, int, tuple[str, ...]]:
    """Return kind, host, port and names."""
    if spec.lower().startswith(VICON_UDP):
        text = spec[len(VICON_UDP) :]
        return VICON_UDP, "", _port(text or str(VICON_PORT), spec), ()
    if not spec.lower().startswith(VRPN):
        raise TruthError(f"{_FORMS}, not {spec[:80]!r}")
    found = _VRPN.fullmatch(spec[len(VRPN) :])
    if found is None:
        raise TruthError(f"{spec[:80]!r} has no host; {_FORMS}")
    names = tuple(each.strip() for each in (found["names"] or "").split(",") if each.strip())
    port = _port(found["port"] or str(VRPN_PORT), spec)
    return VRPN, found["host"].strip("[]"), port, names


def _port(text: str, spec: str) -> int:
    if not re.fullmatch(r"[0-9]{1,5}", text) or not 1 <= int(text) <= 65535:
        raise TruthError(f"{spec[:80]!r} must have a port from 1 to 65535; {_FORMS}")
    return int(text)

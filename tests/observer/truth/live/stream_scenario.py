"""Motion capture of a simulated scenario, as a program, from the repository's root:

    .venv/bin/python -m tests.observer.truth.live.stream_scenario vrpn --port 3883

streams the true bodies of ``simulated:lab`` at 100 Hz in a room frame with z up, rotated and
shifted against the observer's world, on its own clock. It prints what was planted as one line
of JSON, then takes faults from standard input, one command a line: ``drop`` (connections),
``silence`` and ``speak``, ``unseen SHARE``, ``jump SECONDS``, ``quit``.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
import time
from collections.abc import Mapping, Sequence

import numpy as np

from observer.geometry import Pose
from observer.simulation.scenarios import load_scenario
from observer.simulation.world import World

from .mishaps import Mishaps, Poses, Sent, Stream
from .vicon_sender import ViconSender
from .vrpn_server import VrpnServer


def planted_room(yaw_rad: float, shift: Sequence[float]) -> Pose:
    """Return ``T_mocap_room`` of the simulator's room, z up in both."""
    c, s = float(np.cos(yaw_rad)), float(np.sin(yaw_rad))
    return Pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array(shift))


def scenario_poses(world: World, started: float, T_mocap_room: Pose) -> Poses:
    """Return the bodies of a world whose time 0 was at ``started`` on the host's monotonic clock.

    A body's origin is its centre, as in ``TrueBody.position``; it looks along its own x.
    """
    bodies = (world.observer, *world.obstacles)

    def poses(now: float) -> Mapping[str, Pose | None]:
        at = max(0.0, now - started)
        return {
            body.name: T_mocap_room @ body.T_room_body(at) @ Pose(np.eye(3), np.array(body.centre))
            for body in bodies
        }

    return poses


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Motion capture of a simulated scenario.")
    parser.add_argument("protocol", choices=("vrpn", "vicon-udp"))
    parser.add_argument("--port", type=int, default=0, help="0: a free one (vrpn only)")
    parser.add_argument("--scenario", default="lab")
    parser.add_argument("--rate", type=float, default=100.0, help="Hz")
    parser.add_argument("--start", type=float, help="time.monotonic() at the scenario's time 0")
    parser.add_argument("--offset", type=float, default=1.7e9, help="server minus host, s")
    parser.add_argument("--drift", type=float, default=40.0, help="ppm by which the server is fast")
    parser.add_argument("--delay", type=float, default=0.0, help="s, of every message")
    parser.add_argument("--jitter", type=float, default=0.0005, help="s, mean")
    parser.add_argument("--drop", type=float, default=0.0, help="share of messages")
    parser.add_argument("--unseen", type=float, default=0.0, help="share of poses")
    parser.add_argument("--noise", type=float, default=1e-4, help="m, standard deviation")
    parser.add_argument("--yaw", type=float, default=0.7, help="rad, of the room frame")
    parser.add_argument("--shift", type=float, nargs=3, default=(1.5, -2.0, 0.1), help="m")
    parser.add_argument("--tick-hz", type=float, help="stamps count at this rate (vrpn only)")
    return parser.parse_args()


def main() -> None:
    """Run until standard input ends or says ``quit``."""
    given = _arguments()
    world = World(load_scenario(given.scenario))
    started = time.monotonic() if given.start is None else given.start
    mishaps = Mishaps(
        offset_s=given.offset,
        drift_ppm=given.drift,
        since=started,
        delay_s=given.delay,
        jitter_s=given.jitter,
        drop=given.drop,
        unseen=given.unseen,
        tick_hz=given.tick_hz,
    )
    names = [body.name for body in (world.observer, *world.obstacles)]
    peer: VrpnServer | ViconSender
    peer = (
        VrpnServer(names, port=given.port) if given.protocol == "vrpn" else ViconSender(given.port)
    )
    silent = False

    def send(poses: list[Sent]) -> None:
        if not silent:
            peer.send(poses)

    T_mocap_room = planted_room(given.yaw, given.shift)
    poses = scenario_poses(world, started, T_mocap_room)
    stream = Stream(poses, send, mishaps, rate_hz=given.rate, noise_m=given.noise)
    T_mocap_world = T_mocap_room @ world.T_world_room.inverse()
    planted = {
        "port": peer.port if isinstance(peer, VrpnServer) else given.port,
        "bodies": names,
        "start": started,
        "offset_s": given.offset,
        "drift_ppm": given.drift,
        "delay_s": given.delay,
        "T_mocap_world": T_mocap_world.matrix.tolist(),
    }
    sys.stdout.write(json.dumps(planted) + "\n")
    sys.stdout.flush()
    with contextlib.suppress(KeyboardInterrupt):
        for line in sys.stdin:
            word, *more = line.split() or [""]
            if word == "quit":
                break
            if word == "drop" and isinstance(peer, VrpnServer):
                peer.drop_clients()
            elif word in ("silence", "speak"):
                silent = word == "silence"
            elif word == "unseen" and more:
                mishaps.unseen = float(more[0])
            elif word == "jump" and more:
                mishaps.offset_s += float(more[0])
    stream.stop()
    peer.stop()


if __name__ == "__main__":
    main()

"""Choosing live motion capture: over REST, across restarts, from the command line."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from app.contract.commands import LiveTruthOrder, OpenSource, SetTruth
from app.settings import Settings

PATH = "/api/truth/live"


def opened(peer: Any) -> OpenSource:
    """Return the engine's latest opening."""
    found: OpenSource = [each for each in peer.commands if isinstance(each, OpenSource)][-1]
    return found


async def test_live_truth_is_chosen_shown_and_restored_after_a_restart(
    serve: Any, peer: Any, eventually: Any
) -> None:
    async with serve() as served:
        assert (await served.http.get(PATH)).json() is None
        assert (await served.http.get("/api/status")).json()["truth"] is None
        opens = len(peer.commands)
        chosen = {"spec": "vrpn:mocap/Amigo,P3DX", "observer": "Amigo", "ignore": ["hat"]}
        answer = await served.http.put(PATH, json=chosen)
        assert answer.status_code == 200, answer.text
        told = answer.json()
        assert {name: told[name] for name in chosen} == chosen
        assert (told["state"], told["aligned"], told["alignment"]) == ("connecting", False, None)
        assert told["sentence"].startswith("not aligned yet: ")
        assert (await served.http.get(PATH)).json() == told
        assert (await served.http.get("/api/status")).json()["truth"] == told
        # Nothing was reopened for it.
        assert not any(isinstance(each, OpenSource) for each in peer.commands[opens:])
        # An engine that replaces a lost one listens to it at once.
        peer.lose()
        # Saved even while no engine is running.
        again = await served.http.put(PATH, json={"spec": "vicon-udp:51001"})
        assert (again.status_code, again.json()) == (200, None)
        peer.start_process()
        await eventually(lambda: opened(peer).truth == LiveTruthOrder("vicon-udp:51001"))
    # After a restart.
    async with serve() as served:
        assert opened(peer).truth == LiveTruthOrder("vicon-udp:51001")
        assert (await served.http.put(PATH, json={"spec": None})).json() is None
        assert peer.commands[-1] == SetTruth(None)
        started = await served.http.post("/api/runs", json={"source": "simulated:lab"})
        assert started.status_code == 201
        assert opened(peer).truth is None
    # From the command line.
    async with serve(truth="vrpn:mocap") as served:
        assert opened(peer).truth == LiveTruthOrder("vrpn:mocap")
        # Choices for the same server still apply when it is named again.
        await served.http.put(PATH, json={"spec": "vrpn:mocap", "observer": "Amigo"})
    # Named again.
    async with serve(truth="vrpn:mocap"):
        assert opened(peer).truth == LiveTruthOrder("vrpn:mocap", "Amigo")


REFUSED: tuple[tuple[dict[str, Any], str, str], ...] = (
    ({"spec": "vicon:mocap"}, "spec", "live motion capture is given as vrpn:HOST"),
    ({"spec": "vrpn:"}, "spec", "has no host"),
    ({"spec": "vicon-udp:99999"}, "spec", "port from 1 to 65535"),
    ({"spec": "vrpn:a\x00b"}, "spec", "vrpn:HOST"),
    ({"spec": "vrpn:a", "observer": "A", "ignore": ["A"]}, "ignore", "carries the camera"),
    ({"observer": "A"}, "spec", ""),
    ({"spec": "vrpn:a", "ignore": "A"}, "ignore", ""),
    ({"spec": "vrpn:a", "whom": "A"}, "whom", ""),
)


async def test_an_invalid_choice_is_refused(http: Any, peer: Any) -> None:
    for choice, field, sentence in REFUSED:
        answer = await http.put(PATH, json=choice)
        assert answer.status_code == 422, choice
        problem = answer.json()["detail"][0]
        assert field in problem["loc"], choice
        assert sentence in problem["msg"], choice
    assert not any(isinstance(each, SetTruth) for each in peer.commands)


def test_an_invalid_truth_setting_names_the_expected_form() -> None:
    with pytest.raises(ValidationError, match=r"live motion capture is given as vrpn:HOST"):
        Settings(truth="mocap")

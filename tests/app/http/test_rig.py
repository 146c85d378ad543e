"""The rig over REST: typed in, sent as a file, estimated from the floor."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path
from typing import Any

import pytest

from app.contract.commands import OpenSource
from app.http.server import create_app
from app.settings import Settings
from observer.rig.rig import LIMITS
from observer.rig.rig_file import read_rig

from .wire import JSON

FILE = (
    "mount:\n  height_m: 0.42\n  tilt_deg: {estimated: 4.0, sigma: 0.2}\n"
    "T_body_base:\n  P3-DX: [[1, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, -0.2]]\n"
    "models:\n  observer: p3dx-sh\n"
)


def opens(peer: Any) -> list[OpenSource]:
    return [command for command in peer.commands if isinstance(command, OpenSource)]


async def test_a_typed_rig_is_stored_and_used_by_the_engine(
    http: Any, peer: Any, tmp_path: Path
) -> None:
    before = (await http.get("/api/rig")).json()
    assert before["mount"] == {}
    assert before["file"] == str(tmp_path / "rig.yaml")
    assert not (tmp_path / "rig.yaml").exists()
    change = {
        "mount": {"height_m": {"value": 0.35}, "tilt_deg": {"value": -3.5, "sigma": 0.1}},
        "models": {"observer": "amigo", "obstacle": None},
        "for_simulated": True,
    }
    answer = await http.put("/api/rig", json=change)
    assert answer.status_code == 200, answer.text
    told = answer.json()
    assert told["mount"] == {
        "height_m": {"value": 0.35, "sigma": None},
        "tilt_deg": {"value": -3.5, "sigma": 0.1},
    }
    assert (told["models"], told["for_simulated"]) == ({"observer": "amigo"}, True)
    assert (await http.get("/api/rig")).json() == told
    # The open source was reopened with it.
    rig = read_rig(str(opens(peer)[-1].rig_yaml), "it")
    assert rig.mount.height_m is not None
    assert rig.mount.height_m.value == 0.35
    file = await http.get("/api/rig/file")
    assert file.text == (tmp_path / "rig.yaml").read_text()
    assert 'filename="rig.yaml"' in file.headers["content-disposition"]


async def test_an_uploaded_file_is_stored_and_changed_only_where_named(
    http: Any, tmp_path: Path
) -> None:
    sent = await http.put("/api/rig/file", json={"text": FILE})
    assert sent.status_code == 200, sent.text
    assert (sent.json()["bodies"], sent.json()["models"]) == (["P3-DX"], {"observer": "p3dx-sh"})
    change = {"mount": {"height_m": {"value": 0.5}}}
    told = (await http.put("/api/rig", json=change)).json()
    assert told["mount"] == {"height_m": {"value": 0.5, "sigma": None}}
    assert (told["bodies"], told["models"]) == (["P3-DX"], {"observer": "p3dx-sh"})
    kept = read_rig((tmp_path / "rig.yaml").read_text(), "it")
    assert kept.T_body_base["P3-DX"].translation.tolist() == [0.1, 0.0, -0.2]


async def test_an_unreadable_rig_file_is_moved_aside_and_reported(
    serve: Any, tmp_path: Path
) -> None:
    (tmp_path / "rig.yaml").write_text("mount: {height: 3}\n")

    async with serve() as served:
        http = served.http
        (warning,) = (await http.get("/api/status")).json()["warnings"]
        assert "the rig is unknown" in warning
        assert "mount.height" in warning
        assert (tmp_path / "rig.yaml").read_text() == "mount: {height: 3}\n"
        refused = await http.put("/api/rig", json={"mount": {"height_m": {"value": 99}}})
        assert refused.status_code == 422
        assert (tmp_path / "rig.yaml").read_text() == "mount: {height: 3}\n"
        assert (await http.put("/api/rig", json={"mount": {}})).is_success
        assert (tmp_path / "rig.yaml.unreadable").read_text() == "mount: {height: 3}\n"


async def test_values_out_of_range_name_their_key(http: Any, tmp_path: Path) -> None:
    for key, (_, high) in LIMITS.items():
        for text in (high + 0.1, "NaN", "1e999", "true", '"1"', "null"):
            body = f'{{"mount": {{"{key}": {{"value": {text}}}}}}}'
            answer = await http.put("/api/rig", content=body, headers=JSON)
            assert answer.status_code == 422, body
            assert answer.json()["detail"][0]["loc"][:3] == ["body", "mount", key], body
    for body in (
        '{"mount": {"height_m": {"value": 1, "sigma": 0}}}',
        '{"mount": {"height_m": {"value": 1, "sigma": NaN}}}',
        '{"mount": {"height": {"value": 1}}}',
        '{"mount": {"height_m": 1}}',
        '{"mount": {}, "models": {"observer": "tank"}}',
        '{"mount": {}, "models": {"driver": "amigo"}}',
        '{"mount": {}, "for_simulated": 1}',
        '{"mount": {}, "more": 1}',
        "{}",
        "[]",
        "",
    ):
        answer = await http.put("/api/rig", content=body, headers=JSON)
        assert answer.status_code == 422, body
    assert not (tmp_path / "rig.yaml").exists()
    assert (await http.get("/api/rig")).json()["mount"] == {}


async def test_bad_files_are_refused(http: Any, tmp_path: Path) -> None:
    for text, words in (
        ("mount: {height_m: 40}\n", "mount.height_m"),
        ("mount: {height_cm: 40}\n", "height_m"),
        ("a: &a [x, x]\nb: [*a, *a]\n", "rig.yaml"),
        ("[" * 5000, "rig.yaml"),
        ("!!python/object/apply:os.system ['true']", "rig.yaml"),
        ("T_body_base: {P3: [[1, 0], [0, 1]]}\n", "T_body_base.P3"),
        ("mount: {height_m: .nan}\n", "height_m"),
    ):
        answer = await http.put("/api/rig/file", json={"text": text})
        assert answer.status_code == 422, (text, answer.text)
        (problem,) = answer.json()["detail"]
        assert problem["loc"] == ["body", "text"], text[:50]
        assert words in problem["msg"], problem["msg"]
    for body in ('{"text": 1}', '{"text": null}', "{}", f'{{"text": "{"x" * 100_001}"}}'):
        answer = await http.put("/api/rig/file", content=body, headers=JSON)
        assert answer.status_code == 422, body[:50]
    assert not (tmp_path / "rig.yaml").exists()


async def test_a_full_disk_is_answered_with_507(
    http: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        answer = await http.put("/api/rig", json={"mount": {}})
    assert answer.status_code == 507
    assert "no space is left" in answer.json()["detail"]
    assert list(tmp_path.glob("*rig*")) == []


async def test_the_rig_cannot_be_changed_during_a_run(http: Any, peer: Any, tmp_path: Path) -> None:
    assert (await http.post("/api/runs", json={})).status_code == 201
    before = len(opens(peer))
    mount = {"mount": {"height_m": {"value": 0.4}}}
    for path, body in (("", mount), ("/file", {"text": FILE})):
        answer = await http.put(f"/api/rig{path}", json=body)
        assert answer.status_code == 409
        assert "stop it before you change the rig" in answer.json()["detail"]
    assert len(opens(peer)) == before
    assert not (tmp_path / "rig.yaml").exists()


async def test_the_floor_gives_height_tilt_and_roll(http: Any, peer: Any) -> None:
    answer = await http.post("/api/rig/floor")
    assert answer.status_code == 200, answer.text
    told = answer.json()
    # The peer engine's floor lies 0.4 m below a level camera.
    assert told["height_m"]["value"] == pytest.approx(0.4, abs=0.005)
    assert told["tilt_deg"]["value"] == pytest.approx(0.0, abs=0.2)
    assert told["roll_deg"]["value"] == pytest.approx(0.0, abs=0.2)
    assert told["height_m"]["sigma"] > 0
    assert 0.5 < told["share"] <= 1
    assert told["views"] >= 2
    # Estimating changes nothing.
    assert (await http.get("/api/rig")).json()["mount"] == {}
    peer.lose()
    assert (await http.post("/api/rig/floor")).status_code == 503


async def test_a_floor_estimate_needs_an_open_source(serve: Any) -> None:
    async with serve(source="missing") as served:
        answer = await served.http.post("/api/rig/floor")
        assert answer.status_code == 409
        assert "no source is open" in answer.json()["detail"]


async def test_the_real_engine_measures_the_labs_floor(
    serve_app: Any, token: str, tmp_path: Path
) -> None:
    """With the real engine: the lab's camera is 0.40 m above the floor, tilted 5 degrees down."""

    settings = Settings(data=tmp_path)
    async with asyncio.timeout(100), serve_app(create_app(settings, token), settings) as served:
        while (await served.http.get("/api/status")).json()["frames_observed"] < 5:
            await asyncio.sleep(0.1)
        answer = await served.http.post("/api/rig/floor")
        assert answer.status_code == 200, answer.text
        told = answer.json()
        assert told["height_m"]["value"] == pytest.approx(0.40, abs=0.01)
        assert told["tilt_deg"]["value"] == pytest.approx(5.0, abs=0.5)
        assert abs(told["roll_deg"]["value"]) < 0.5
        assert abs(told["height_m"]["value"] - 0.40) < 4 * told["height_m"]["sigma"]
        status = (await served.http.get("/api/status")).json()
        assert status["engine"]["restarts"] == 0

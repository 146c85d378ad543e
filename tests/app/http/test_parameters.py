"""Parameters and presets over REST."""

from __future__ import annotations

import asyncio
from typing import Any

from app.contract.drive import SetGuard

THRESHOLD = "ego_motion.ransac_threshold_px"


async def test_parameters_reach_the_engine_and_survive_a_restart(
    serve: Any, peer: Any, storage: Any
) -> None:
    async with serve() as served:
        answer = await served.http.patch(
            "/api/parameters", json={THRESHOLD: 3.5, "stereo.matcher": "bm"}
        )
        state = answer.json()
        assert state["revision"] == 1
        assert state["values"][THRESHOLD] == 3.5
        assert state["frame"] == 1
        assert state["preset"] is None
        assert peer.parameters[THRESHOLD] == 3.5
        assert peer.commands[-1].revision == 1
        # Unchanged values make no new revision.
        again = await served.http.patch("/api/parameters", json={THRESHOLD: 3.5})
        assert again.json()["revision"] == 1
        assert (await served.http.get("/api/status")).json()["parameters_revision"] == 1
    with storage:
        assert storage.load_parameters().revision == 1
        assert storage.load_parameters().values["stereo.matcher"] == "bm"
        (change,) = storage.parameter_revisions(None)
        assert change.difference == {THRESHOLD: 3.5, "stereo.matcher": "bm"}


async def test_parameters_changed_without_an_engine_reach_the_next_one(
    http: Any, peer: Any
) -> None:
    peer.lose()
    state = (await http.patch("/api/parameters", json={THRESHOLD: 4.0})).json()
    assert state["values"][THRESHOLD] == 4.0
    assert state["frame"] is None
    peer.start_process()
    while peer.opened is None:
        await asyncio.sleep(0.01)
    assert peer.opened.parameters[THRESHOLD] == 4.0
    assert peer.opened.parameters_revision == 1


async def test_presets_are_saved_used_and_deleted(http: Any) -> None:
    names = [p["name"] for p in (await http.get("/api/presets")).json()]
    assert names == ["paper", "default"]
    await http.patch("/api/parameters", json={THRESHOLD: 2.5})
    saved = await http.post("/api/presets", json={"name": "My own ü"})
    assert saved.status_code == 201
    assert saved.json()["built_in"] is False
    assert saved.json()["values"][THRESHOLD] == 2.5
    now = (await http.get("/api/parameters")).json()
    assert now["preset"] == "My own ü"
    paper = next(p for p in (await http.get("/api/presets")).json() if p["name"] == "paper")
    used = await http.patch("/api/parameters", json=paper["values"])
    assert used.json()["preset"] == "paper"
    taken = await http.post("/api/presets", json={"name": "My own ü"})
    assert taken.status_code == 409
    assert (await http.post("/api/presets", json={"name": "paper"})).status_code == 409
    assert (await http.delete("/api/presets/My own ü")).status_code == 204
    assert (await http.delete("/api/presets/My own ü")).status_code == 404
    assert (await http.delete("/api/presets/paper")).status_code == 409


async def test_values_remember_the_preset_they_are_based_on(serve: Any) -> None:
    async with serve() as served:
        http = served.http

        async def now(**changes: Any) -> tuple[str | None, str]:
            state = (await http.patch("/api/parameters", json=changes)).json()
            return state["preset"], state["based_on"]

        assert await now() == ("default", "default")
        assert await now(**{THRESHOLD: 2.5}) == (None, "default")
        paper = next(p for p in (await http.get("/api/presets")).json() if p["name"] == "paper")
        # Sending a preset's values selects it.
        assert await now(**paper["values"]) == ("paper", "paper")
        assert await now(**{THRESHOLD: 2.5}) == (None, "paper")
        await http.post("/api/presets", json={"name": "mine"})
        assert await now() == ("mine", "mine")
        assert await now(**{THRESHOLD: 3.0}) == (None, "mine")
        # An unsaved mixture says what it is based on.
        told = await http.patch("/api/parameters?based_on=default", json={"frames.interval": 3})
        assert (told.json()["preset"], told.json()["based_on"]) == (None, "default")
        unknown = await http.patch("/api/parameters?based_on=papre", json={THRESHOLD: 9.0})
        assert unknown.status_code == 422
        assert "there is no preset 'papre'" in unknown.text
        state = (await http.patch("/api/parameters?based_on=mine", json={})).json()
        assert (state["based_on"], state["values"][THRESHOLD]) == ("mine", 3.0)
        revision = state["revision"]
    async with serve() as served:
        state = (await served.http.get("/api/parameters")).json()
        assert (state["based_on"], state["revision"]) == ("mine", revision)
        await served.http.delete("/api/presets/mine")
        # The nearest built-in preset takes its place.
        state = (await served.http.get("/api/parameters")).json()
        assert (state["preset"], state["based_on"]) == (None, "paper")


async def test_a_preset_is_replaced_only_on_request(http: Any) -> None:
    made = await http.post("/api/presets", json={"name": "mine", "help": "for the corridor"})
    assert made.status_code == 201
    await http.patch("/api/parameters", json={THRESHOLD: 2.5})
    assert (await http.post("/api/presets", json={"name": "mine"})).status_code == 409
    replaced = await http.put("/api/presets/mine", json={})
    assert replaced.json()["values"][THRESHOLD] == 2.5
    assert replaced.json()["help"] == "for the corridor"
    assert (await http.get("/api/parameters")).json()["preset"] == "mine"
    for name, status in (("paper", 409), ("new", 200), ("hall%2Fwest", 200)):
        assert (await http.put(f"/api/presets/{name}", json={})).status_code == status
    names = [p["name"] for p in (await http.get("/api/presets")).json()]
    assert names == ["paper", "default", "hall/west", "mine", "new"]
    assert (await http.delete("/api/presets/hall%2Fwest")).status_code == 204


async def test_a_preset_file_is_validated_like_any_change(http: Any) -> None:
    file = {
        "format": "dynamic-observer preset",
        "name": "theirs",
        "help": "from the other lab",
        # From an older version, which did not have all parameters either.
        "values": {"following.spacing_px": 20, THRESHOLD: 2.5},
    }
    before = (await http.get("/api/parameters")).json()
    taken = (await http.post("/api/presets", json=file)).json()
    assert taken["values"]["klt_tracking.spacing_px"] == 20
    assert set(taken["values"]) == set(before["values"])
    # It is saved, but not activated.
    assert (await http.get("/api/parameters")).json() == before
    for values, sentence in (
        ({THRESHOLD: 99}, "must be a finite number from 0.1 to 20 px"),
        ({"flow.treshold": 1}, "there is no such parameter"),
    ):
        refused = await http.post("/api/presets", json={**file, "name": "bad", "values": values})
        assert refused.status_code == 422
        assert sentence in refused.text
    other = await http.post("/api/presets", json={**file, "name": "bad", "format": "a rig"})
    assert other.status_code == 422
    names = [p["name"] for p in (await http.get("/api/presets")).json()]
    assert names == ["paper", "default", "theirs"]


async def test_the_schema_describes_every_parameter(served: Any) -> None:
    schema = (await served.http.get("/api/parameters/schema")).json()
    values = (await served.http.get("/api/parameters")).json()["values"]
    assert [entry["name"] for entry in schema] == list(values)
    threshold = next(entry for entry in schema if entry["name"] == THRESHOLD)
    assert (threshold["minimum"], threshold["maximum"], threshold["unit"]) == (0.1, 20.0, "px")
    assert "choices" not in threshold
    assert threshold["basic"] is True
    assert "basic" not in next(e for e in schema if e["name"] == "ego_motion.min_inliers")


async def test_guard_parameters_have_their_own_revision(
    serve: Any, peer: Any, storage: Any
) -> None:
    async with serve() as served:
        http = served.http
        await http.patch("/api/parameters", json={THRESHOLD: 3.5})
        state = (await http.patch("/api/parameters", json={"guard.margin_m": 0.3})).json()
        assert state["values"]["guard.margin_m"] == 0.3
        assert (state["revision"], state["driving_revision"], state["frame"]) == (1, 1, 1)
        assert state["preset"] is None
        assert (peer.parameters["guard.margin_m"], peer.commands[-1].revision) == (0.3, 1)
        status = (await http.get("/api/status")).json()
        assert (status["parameters_revision"], status["driving_revision"]) == (1, 1)
        refused = await http.patch("/api/parameters", json={"guard.margin_m": 9, THRESHOLD: 2.0})
        assert refused.status_code == 422
        assert (await http.get("/api/parameters")).json()["values"] == state["values"]
    with storage:
        assert storage.load_parameters().values["guard.margin_m"] == 0.3
        assert storage.parameter_revisions(None)[-1].difference == {"guard.margin_m": 0.3}


async def test_planner_parameters_reach_the_engine_but_not_the_guard(
    serve: Any, peer: Any, drive: Any
) -> None:
    async with serve() as served:
        before = (await served.http.get("/api/parameters")).json()
        told = len(drive.of(SetGuard))
        state = (
            await served.http.patch("/api/parameters", json={"navigation.berth_m": 0.3})
        ).json()
        # Vision is unaffected, but other pages learn of the change.
        assert (state["revision"], state["frame"]) == (before["revision"], before["frame"])
        assert state["driving_revision"] == before["driving_revision"] + 1
        assert peer.parameters["navigation.berth_m"] == 0.3
        assert peer.commands[-1].revision == before["revision"]
        refused = await served.http.patch("/api/parameters", json={"navigation.berth_m": -1})
        assert refused.status_code == 422
        assert "from 0 to 2 m" in refused.text
        assert len(drive.of(SetGuard)) == told


async def test_parameters_unused_by_the_method_are_accepted_with_a_note(served: Any) -> None:
    changes = {"tracking.gate": 4.0, THRESHOLD: 2.0, "stereo.matcher": "bm"}
    state = (await served.http.patch("/api/parameters", json=changes)).json()
    assert state["values"]["tracking.gate"] == 4.0
    cloud, gate = state["notes"]
    assert gate == (
        "tracking.gate has no effect with the current method, rigid; "
        "it applies to homography and affine"
    )
    assert cloud.startswith("stereo.matcher")
    assert cloud.endswith("and to the dense point cloud with every method")
    changes = {"ego_motion.model": "affine", "tracking.gate": 3.0}
    state = (await served.http.patch("/api/parameters", json=changes)).json()
    assert state["notes"] == []


async def test_an_old_name_is_refused_naming_the_new_one(served: Any) -> None:
    changes = {"following.spacing_px": 20}
    refused = await served.http.patch("/api/parameters", json=changes)
    assert refused.status_code == 422
    assert "has been renamed to klt_tracking.spacing_px" in refused.text

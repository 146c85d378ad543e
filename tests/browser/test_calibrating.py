"""Calibrating in the panel: the whole wizard by keyboard alone, and its result."""

from __future__ import annotations

import os
import re
import signal
import sys
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import pytest
from playwright.sync_api import expect
from scipy.spatial.transform import Rotation

from observer.calibration.formats.opencv_file import read_calibration
from observer.camera import StereoCalibration, as_gray
from observer.parameters import StereoParameters
from observer.simulation.imaging import StereoImager, undistorted_rays
from observer.simulation.scenarios import load_scenario
from observer.simulation.visibility import cast
from observer.simulation.world import World
from observer.vision.rectification import Rectification
from observer.vision.stereo import disparity_map

from .conftest import Eventually, Json, KeepPicture, OpenPanel, Server
from .keyboard_user import KeyboardUser

# The entry of a calibration, and the content of its file.
Made = tuple[Json, StereoCalibration]

_NAME = "Two webcams by keyboard"
# The same board, with each of the 28 poses held just long enough, and cameras at 10 images/s: a
# third of the frames.
_SCENARIO = """\
based_on: calibration
title: A chessboard in quick hands
help: For a test of the wizard, which need not take as long as a person does.
frame_rate: 10
duration_s: 22.4
board: {hold_s: 0.5, move_s: 0.3}
"""


def _tell(measured: str) -> None:
    """Print a measurement for those who run it with -s."""
    sys.stdout.write(f"{measured}\n")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Two uncalibrated cameras, and a person who shows them a board."""
    path = tmp_path_factory.mktemp("scenario") / "held_board.yaml"
    path.write_text(_SCENARIO)
    return f"simulated:{path}"


def _now(server: Server) -> Any:
    return server.get("/status")["calibrating"]


def _hurry(server: Server, rate: float = 4.0) -> None:
    """Play the simulation faster, as far as the machine can."""
    server.api.post("/api/playback", json={"rate": rate}).raise_for_status()


def _play(server: Server, **change: Any) -> None:
    server.api.post("/api/playback", json=change).raise_for_status()


@pytest.fixture(scope="module", autouse=True)
def _as_before(server: Server) -> Iterator[None]:
    """Leave the lab open and no calibration for other tests."""
    yield
    server.api.delete("/api/calibrating")
    server.api.put("/api/source", json={"source": "simulated:lab"}).raise_for_status()
    for kept in server.get("/calibrations"):
        server.api.delete(f"/api/calibrations/{kept['id']}").raise_for_status()


@pytest.fixture(autouse=True)
def _nothing_is_calibrated(server: Server, eventually: Eventually) -> None:
    """End calibrating, even if the previous test failed half-way."""
    eventually(lambda: server.get("/status")["source"], 40)
    if _now(server):
        server.api.delete("/api/calibrating").raise_for_status()
    eventually(lambda: server.get("/status")["engine"]["state"] == "preview", 40)
    _play(server, paused=False, rate=1.0)


@pytest.mark.slow
@pytest.mark.timeout(240)
def test_the_whole_wizard_works_by_keyboard_alone(
    server: Server,
    source: str,
    open_panel: OpenPanel,
    eventually: Eventually,
    keep_picture: KeepPicture,
) -> None:
    page = open_panel(refusals=True)
    hands = KeyboardUser(page)
    hands.open_calibrations()
    hands.go("Calibrate cameras")
    hands.press("Enter")
    hands.focus_is_on("Calibrate: Board")

    hands.go("Square, mm")
    hands.enter("25")
    hands.go("Cameras")
    hands.enter(source)
    hands.go("Start with these cameras")
    hands.press("Enter")
    hands.focus_is_on("Calibrate: Views")
    assert _now(server)["board"]["square_mm"] == 25
    keep_picture(page, "calibrating-views")

    # Capture one view by hand and undo it; nothing is captured automatically meanwhile.
    hands.go("Capture automatically")
    hands.press("Space")
    eventually(lambda: _now(server)["automatic"] is False)
    expect(page.locator("#capture-automatic")).not_to_be_checked()
    hands.go("Capture now", "Shift+Tab")
    before = len(_now(server)["views"])

    def captured() -> bool:
        # Refused while either camera does not see the board.
        hands.press("Enter")
        page.wait_for_timeout(250)
        return len(_now(server)["views"]) > before

    eventually(captured, 30)
    page.wait_for_function("() => document.querySelectorAll('.view-list li').length > 0")
    assert hands.focus()[0] == "Capture now"
    taken = len(_now(server)["views"])
    hands.go("Undo")
    hands.press("Enter")
    eventually(lambda: len(_now(server)["views"]) == taken - 1)
    if taken == 1:
        hands.focus_is_on("Capture now")
    else:
        assert hands.focus()[0] == "Undo"
    hands.go("Capture automatically")
    hands.press("Space")
    eventually(lambda: _now(server)["automatic"] is True)

    # The status arrives twelve times a second: the focus stays on the same element.
    hands.go("2 Views", "Shift+Tab")
    place = hands.focus()
    _hurry(server)
    page.wait_for_function(
        "() => document.querySelectorAll('.coverage [data-full]').length === 4", timeout=150_000
    )
    eventually(lambda: _now(server)["look"]["enough"], 60)
    assert hands.focus() == place
    keep_picture(page, "calibrating-enough")
    _play(server, paused=True)

    hands.go("Compute calibration")
    hands.press("Enter")
    hands.focus_is_on("Cancel")
    hands.press("Enter")
    hands.focus_is_on("Compute calibration")
    assert _now(server)["computing"] is None
    assert _now(server)["result"] is None
    hands.press("Enter")
    hands.focus_is_on("Cancel")
    page.wait_for_selector("observer-result-step:not([hidden]) .verdict-table", timeout=90_000)
    hands.focus_is_on("Calibrate: Result")
    verdict = page.locator("observer-result-step .verdict.big")
    expect(verdict).to_have_text(
        re.compile(r"At 3 m, depth is accurate to ± \d+(\.\d)? c?m\b.* at \d+(\.\d+)? m/s")
    )
    _tell(verdict.inner_text())
    expect(page.locator("observer-result-step")).to_contain_text(
        # The effect of a board that fills the picture is reported, too.
        re.compile(
            r"Epipolar error \d\.\d\d px: matching points|squares of a board can cause false"
        )
    )
    keep_picture(page, "calibrating-result")

    hands.go("Name")
    hands.enter(_NAME)
    hands.go("Save and use")
    hands.press("Enter")
    hands.focus_is_on("Calibrate cameras")
    expect(page.locator("observer-calibration-wizard")).to_be_hidden()
    expect(page.locator(".headline-context")).to_contain_text(f"calibration {_NAME}")
    assert server.get("/status")["calibration"]["name"] == _NAME


@pytest.fixture
def made(server: Server, source: str, eventually: Eventually) -> Made:
    """The calibration made by keyboard, or, if that test was skipped, one made by REST."""
    found = [each for each in server.get("/calibrations") if each["name"] == _NAME]
    if not found:
        start = {"source": source, "square_mm": 25}
        server.api.post("/api/calibrating", json=start).raise_for_status()
        _hurry(server)
        eventually(lambda: (_now(server)["look"] or {}).get("enough"), 150)
        server.api.post("/api/calibrating/compute", json={}).raise_for_status()
        eventually(lambda: _now(server)["result"], 90)
        saved = server.api.post("/api/calibrating/save", json={"name": _NAME})
        found = [saved.raise_for_status().json()]
    text = server.api.get(f"/api/calibrations/{found[0]['id']}/file").text
    return found[0], read_calibration(text, name=_NAME)


@pytest.mark.slow
@pytest.mark.timeout(240)
def test_a_saved_calibration_is_previewed_and_checked_with_a_tape_by_keyboard(
    server: Server,
    source: str,
    made: Made,
    open_panel: OpenPanel,
    eventually: Eventually,
    keep_picture: KeepPicture,
) -> None:
    opening = {"source": source, "calibration": made[0]["id"]}
    server.api.put("/api/source", json=opening).raise_for_status()
    page = open_panel(refusals=True)
    _play(server, paused=True)
    hands = KeyboardUser(page)
    hands.open_calibrations()
    expect(page.locator(".item-list li", has_text=_NAME)).to_contain_text("in use")
    hands.go(f"Preview calibration {_NAME}")
    look = hands.focus()
    hands.press("Enter")
    dialog = page.get_by_role("dialog")
    expect(dialog.locator(".verdict").last).to_contain_text(
        re.compile("Epipolar error|look alike"), timeout=10_000
    )
    hands.focus()
    hands.go("Tape check")
    hands.press("Enter")
    hands.go("Choose the image centre")
    hands.press("Enter")
    # Move the mark until it is on a flat textured surface.
    said = dialog.locator(".tape-check [role=status]")
    for key in ["ArrowUp"] * 12 + ["ArrowLeft"] * 12:
        expect(said).not_to_be_empty()
        place_was = dialog.locator(".place-mark").get_attribute("style")
        with page.expect_response("**/depth?*"):
            hands.press(key)
        assert dialog.locator(".place-mark").get_attribute("style") != place_was
        if said.inner_text().startswith("Stereo distance: "):
            break
    stated = float(re.search(r"Stereo distance: (\d+\.\d+) m", said.inner_text()).group(1))
    assert hands.focus()[0] == "Choose the image centre"
    hands.go("Tape measurement, m")
    hands.enter(f"{stated:.2f}")
    hands.go("Compare")
    hands.press("Enter")
    kept = eventually(lambda: server.get("/calibrations")[0]["tape_checks"])
    assert kept[0]["measured_m"] == pytest.approx(stated, abs=0.006)
    assert kept[0]["agrees"]
    expect(dialog.locator(".tape-check li")).to_contain_text(kept[0]["sentence"])
    assert hands.focus()[0] == "Compare"
    keep_picture(page, "calibrating-tape")
    hands.press("Escape")
    expect(dialog).to_have_count(0)
    assert hands.focus() == look


def _turned_deg(rotation: Any) -> float:
    return float(np.degrees(Rotation.from_matrix(rotation).magnitude()))


@pytest.mark.slow
@pytest.mark.timeout(240)
def test_the_resulting_calibration_is_close_to_the_truth(made: Made) -> None:
    entry, found = made
    true = World(load_scenario("calibration"), 0).true_calibration
    focal = [abs(a[i, i] / b[i, i] - 1) for a, b in ((found.K1, true.K1), (found.K2, true.K2))
             for i in (0, 1)]  # fmt: skip
    between = found.R @ true.R.T
    vergence = float(np.degrees(Rotation.from_matrix(between).as_rotvec()[1]))
    held_out = entry["report"]["held_out"]
    _tell(
        f"focal length within {100 * max(focal):.3f} %, "
        f"baseline {100 * (found.baseline / true.baseline - 1):+.3f} %, "
        f"rotation {_turned_deg(between):.4f} deg, vergence {vergence:+.4f} deg, "
        f"rows of held-out views p95 {held_out['p95_px']:.3f} px"
    )
    assert max(focal) < 0.003
    assert found.baseline == pytest.approx(true.baseline, rel=0.005)
    assert _turned_deg(between) < 0.05
    assert abs(vergence) < 0.02
    assert held_out["p95_px"] <= 0.3


@pytest.mark.slow
@pytest.mark.timeout(240)
def test_lab_depth_with_this_calibration_is_accurate_at_three_metres(
    server: Server, made: Made
) -> None:
    entry, found = made
    opening = {"source": "simulated:webcams", "calibration": entry["id"]}
    server.api.put("/api/source", json=opening).raise_for_status()
    assert server.get("/status")["calibration"]["id"] == entry["id"]

    world = World(load_scenario("webcams"), 0)
    left, right = StereoImager(world).pair(0, 0.0)
    rectification = Rectification(found)
    disparity = disparity_map(
        *rectification.apply(as_gray(left), as_gray(right)), StereoParameters()
    )
    camera = rectification.camera
    v, u = np.nonzero(np.isfinite(disparity) & (disparity > 1))
    stated = np.linalg.norm(camera.triangulate(np.stack([u, v], -1), disparity[v, u]), axis=-1)

    # The same places in the original image, for which the truth is known.
    straight = [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(len(u))]
    rays = np.stack(straight, -1) @ rectification.R_rectified_left
    taken = cv2.projectPoints(rays[:, None], np.zeros(3), np.zeros(3), found.K1, found.D1)[0]
    column, row = np.rint(taken[:, 0]).astype(int).T
    inside = (column >= 0) & (column < found.width) & (row >= 0) & (row < found.height)
    column, row, stated = column[inside], row[inside], stated[inside]
    true = world.true_calibration
    rays = undistorted_rays(true.width, true.height, true.K1, true.D1)[row, column]
    depth = 1 / cast(world, world.T_room_left(0.0).inverse(), rays, 0.0).inverse_depth
    truth = depth * np.sqrt(1 + (rays**2).sum(axis=-1))
    near_three = (depth > 2.7) & (depth < 3.3)
    error = np.abs(stated / truth - 1)[near_three]
    _tell(f"depth at 3 m: median error {100 * np.median(error):.2f} % of {error.size} pixels")
    assert error.size > 2000
    assert np.median(error) < 0.02


# Announcements and word changes in three seconds, and whether the controls stayed in place.
_CALM = """async () => {
  let spoken = 0;
  const status = document.querySelector("observer-capture-step .capture-main [role=status]");
  new MutationObserver(() => spoken++).observe(status, { childList: true, subtree: true });
  let shown = 0;
  const words = document.querySelector("observer-capture-step .capture-words");
  new MutationObserver(() => shown++).observe(words, { childList: true, subtree: true });
  const held = [...document.querySelectorAll(".wizard-step, .view-list li, .view-list button")];
  await new Promise((resolve) => setTimeout(resolve, 3000));
  return [spoken, shown, held.every((element) => element.isConnected)];
}"""


@pytest.mark.slow
@pytest.mark.patient
def test_views_survive_reloads_and_engines_and_are_shared_by_pages(
    server: Server, source: str, open_panel: OpenPanel, eventually: Eventually
) -> None:
    page, other = open_panel(), open_panel()
    server.api.put("/api/source", json={"source": "simulated:lab"}).raise_for_status()
    page.get_by_role("tab", name="Calibration").click()
    page.get_by_role("button", name="Calibrate cameras").click()
    page.get_by_label("Square, mm").fill("25")
    page.locator("#board-source").fill(source)
    page.get_by_role("button", name="Start with these cameras").click()
    expect(other.get_by_role("heading", name="Calibrate: Views")).to_be_visible(timeout=20_000)
    _hurry(server)
    eventually(lambda: len(_now(server)["views"]) >= 2, 60)
    # At real speed, as with a real person.
    _hurry(server, 1.0)
    spoken, shown, stayed = page.evaluate(_CALM)
    assert spoken <= 4
    assert 0 < shown <= 9
    assert stayed
    _play(server, paused=True)
    names = [view["name"] for view in _now(server)["views"]]

    page.reload()
    for each in (page, other):
        expect(each.get_by_role("heading", name="Calibrate: Views")).to_be_visible(timeout=20_000)
        expect(each.locator(".view-list li b")).to_have_text(names, timeout=10_000)
        each.wait_for_function(
            "() => [...document.querySelectorAll('.view-list img')].every((i) => i.naturalWidth)"
        )

    before = server.get("/status")["engine"]
    os.kill(before["pid"], signal.SIGKILL)
    eventually(lambda: server.get("/status")["engine"]["generation"] > before["generation"], 30)
    eventually(lambda: server.get("/status")["engine"]["state"] == "calibrating", 30)
    assert [view["name"] for view in _now(server)["views"]][: len(names)] == names
    for each in (page, other):
        expect(each.locator(".view-list li b").nth(len(names) - 1)).to_have_text(names[-1])
    # It continues from there with further views.
    _hurry(server)
    eventually(lambda: len(_now(server)["views"]) > len(names), 60)

    page.get_by_role("button", name="Exit").click()
    question = page.get_by_role("dialog")
    expect(question).to_contain_text(re.compile(r"\d+ captured views"))
    question.get_by_role("button", name="Cancel").click()
    assert _now(server) is not None
    page.get_by_role("button", name="Exit").click()
    question.get_by_role("button", name="Exit calibration").click()
    for each in (page, other):
        expect(each.locator("observer-calibration-wizard")).to_be_hidden(timeout=20_000)
        each.wait_for_selector('html[data-freshness="fresh"]', timeout=20_000)
    assert _now(server) is None
    assert server.get("/status")["source"]["spec"] == "simulated:lab"

"""Figure 17 on the page: live, of stored runs, several side by side, and as files."""

from __future__ import annotations

import csv
import math
import re
from typing import Any

import numpy as np
from playwright.sync_api import Locator, Page, expect

from .conftest import Eventually, KeepPicture, OpenPanel, Pixels, Server

_SPEED, _STD, _TOP = 0.4, 0.05, 0.4 * 1.15
_SHOW = """async (charts) => {
  const { RunChart } = await import("/static/app/runs/run-chart.js");
  const old = document.querySelector("#charted");
  const chart = old ?? new RunChart();
  chart.id = "charted";
  chart.style.gridColumn = "1 / -1";
  if (!old) document.querySelector("main").prepend(chart);
  chart.show(charts);
}"""
# Ten seconds at 10 Hz: truth is missing from 4 to 5 s; at 7 s the body gets another track.
_LIVE = """async () => {
  const { SpeedHistory } = await import("/static/app/chart/speed-history.js");
  const { gapsIn, joined, speedAt } = await import("/static/app/chart/speed-curves.js");
  const history = new SpeedHistory(60);
  for (let i = 0; i < 100; i += 1) {
    const [time, id] = [i / 10, i < 70 ? 3 : 5];
    const coasts = i >= 20 && i < 25;
    const obstacle = { id, state: coasts ? "coasting" : "confirmed", speed: 0.4, speed_std: 0.05,
      velocity_time: time - 0.05 };
    const body = { id: 1, name: "cart", role: "obstacle", speed: 0.41, commanded_speed: -0.5,
      track_id: id };
    history.add({ sequence: i, truth: i >= 40 && i < 50 ? [] : [body],
      line: { time, segment: 0, obstacles: [obstacle] } });
    history.addWheels([{ role: "obstacle", time, sent_mps: -0.5, encoder_mps: i < 50 ? 0.4 : null },
      { role: "obstacle", time: time + 100, sent_mps: 9, encoder_mps: 9 }]);
  }
  const curve = (key) => history.curves.get(key);
  const [seen, truth] = [curve("0/0/3"), curve("truth/1")];
  const rows = joined([seen, truth]);
  return { gaps: [gapsIn(seen), gapsIn(truth)], changes: history.changes, first: seen.times[0],
    drop_out: speedAt(truth, 4.5, 0.3), sent: speedAt(curve("sent/obstacle"), 5, 0.1),
    wheels_end: curve("encoder/obstacle").times.at(-1),
    labels: [...history.curves.values()].map(({ label }) => label),
    upper: rows[1][rows[0].indexOf(seen.times[5])],
    across: rows[4].filter((_, i) => rows[0][i] > 3.95 && rows[0][i] < 4.95) };
}"""


def _stored(name: str, rerun_of: str | None = None, rmse: float = 0.02) -> dict[str, Any]:
    """A body at 0.4 m/s: not measured from 4 to 5 s, truth missing from 12 to 13 s, and track 3
    becomes track 5 at 8 s."""
    times = [round(0.1 * i, 3) for i in range(201)]

    def curve(kind: str, label: str, own: list[float], **more: Any) -> dict[str, Any]:
        speeds = [None if kind == "truth" and 12 <= t < 13 else _SPEED for t in own]
        stds = [_STD] * len(own) if kind == "estimate" else None
        return {"kind": kind, "label": label, "role": "obstacle", "track_id": None, "body": None,
                "segment": None, "times": own, "speeds": speeds, "stds": stds, **more}  # fmt: skip

    tracks = {3: [t for t in times if t < 8 and not 4 < t < 5], 5: [t for t in times if t >= 8]}
    errors = {"body": None, "samples": 190, "bias_mps": -0.001, "rmse_mps": rmse,
              "maximum_mps": 0.1, "coverage": 0.95, "covered_of": 190,
              "seen_share": 0.9}  # fmt: skip
    return {
        "run": {"id": name, "name": name, "state": "finished", "source": "simulated:lab",
                "started_at": "2026-01-01T00:00:00Z", "ended_at": "2026-01-01T00:00:20Z",
                "begin_s": 0.0, "duration_s": 20.0,
                "rerun_of": rerun_of},
        "aligned": True, "sentence": "Ground truth was recorded with the run.", "alignment": None,
        "curves": [
            *(curve("estimate", f"track 0:{n}", own, track_id=n, segment=0, body="cart")
              for n, own in tracks.items()),
            curve("truth", "cart", times, body="cart"),
            curve("commanded", "commanded", times),
        ],
        "changes": [{"time": 8.0, "body": "cart", "before": "0:3", "after": "0:5"}],
        "errors": [{**errors, "group": "all", "label": "whole run"},
                   {**errors, "group": "direction", "label": "towards"},
                   {**errors, "group": "direction", "label": "left", "coverage": None},
                   {**errors, "group": "track", "label": "0:3", "body": "cart"}],
    }  # fmt: skip


def _end(page: Page, word: str) -> Locator:
    return page.get_by_role("spinbutton", name=f"Visible range {word}, seconds")


def _range(page: Page) -> tuple[float, float]:
    begin, end = (_end(page, word).input_value() for word in ("from", "to"))
    return float(begin), float(end)


def _see(page: Page, begin: float, end: float) -> None:
    _end(page, "from").fill(str(begin))
    _end(page, "to").fill(str(end))
    page.keyboard.press("Tab")
    assert _range(page) == (begin, end)


def _read_middle(page: Page) -> str:
    box = page.locator("#charted .u-over").first.bounding_box()
    page.mouse.move(5, 5)
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 20)
    reading = page.locator("#charted .chart-reading").first
    expect(reading).to_contain_text(re.compile(r"\d s"))
    return " ".join(reading.inner_text().split())


def _is_ground(picture: np.ndarray, x: float, y: float) -> bool:
    """Return whether nothing is drawn around a place, given in shares of the picture's size."""
    height, width = picture.shape[:2]
    row, column = round(y * height), round(x * width)
    around = picture[row - 2 : row + 3, column - 2 : column + 3].reshape(-1, 3).astype(int)
    return bool(np.abs(around - picture[-5, 12].astype(int)).max() < 12)


def test_stored_runs_are_charted_read_zoomed_and_compared(
    open_panel: OpenPanel, pixels: Pixels, keep_picture: KeepPicture
) -> None:
    page = open_panel(color_scheme="light")
    page.evaluate(_SHOW, [_stored("crossing")])
    chart = page.locator("#charted")
    expect(chart.locator(".uplot")).to_have_count(1)
    expect(chart.locator("[data-fact=changes]")).to_have_text(
        "Identity switches: 8.0 s (cart: 3 → 5)."
    )
    expect(chart.locator("[data-fact=gaps]")).to_contain_text("11.9 to 13.0 s")
    assert _range(page) == (0, 20)
    keep_picture(page, "run-chart")

    # The band is 95 %, not one standard deviation, and ends where nothing was measured.
    page.mouse.move(5, 5)
    plot = pixels(chart.locator(".u-over"))
    within, outside = (1 - (_SPEED - factor * _STD) / _TOP for factor in (1.6, 2.4))
    assert not _is_ground(plot, 0.15, within)
    assert _is_ground(plot, 0.15, outside)
    assert _is_ground(plot, 4.5 / 20, within)
    assert not _is_ground(plot, 8 / 20, 0.9), "the change of identity is not drawn"

    _see(page, 4.2, 4.8)
    read = _read_middle(page)
    assert "Ground truth cart 0.40" in read
    assert "Obstacle" not in read
    _see(page, 12.2, 12.8)
    read = _read_middle(page)
    assert "Obstacle 5 0.40 (0.30–0.50)" in read
    assert "Ground truth" not in read

    canvas = chart.locator(".u-over")
    canvas.dblclick()
    assert _range(page) == (0, 20)
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 50)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 60, steps=3)
    page.mouse.up()
    assert np.allclose(_range(page), (5, 10), atol=0.1)
    page.get_by_role("application").focus()
    page.keyboard.press("0")
    page.keyboard.press("+")
    assert math.isclose(np.diff(_range(page))[0], 10)
    page.keyboard.press("ArrowRight")
    expect(chart.locator(".chart-panel [role=status]")).to_contain_text("commanded 0.40")
    # Shown again, as while a run is in progress, it keeps its zoom.
    page.evaluate(_SHOW, [_stored("crossing")])
    assert math.isclose(np.diff(_range(page))[0], 10)
    expect(page.get_by_role("application")).to_be_focused()

    rows = chart.locator(".chart-errors tbody tr")
    assert rows.nth(1).inner_text().split() == [
        "Moving", "towards", "190", "−0.001", "0.020", "0.100", "95", "%", "90", "%",
    ]  # fmt: skip
    assert rows.nth(2).inner_text().split()[-3:] == ["–", "90", "%"]

    page.evaluate(_SHOW, [_stored("crossing"), _stored("affine", "crossing", rmse=0.05)])
    expect(chart.locator(".uplot")).to_have_count(2)
    chart.get_by_text("Overlaid").click()
    expect(chart.locator(".uplot")).to_have_count(1)
    expect(chart.locator("[data-best]").first).to_have_text("0.020")
    read = _read_middle(page)
    assert "crossing: Obstacle 5" in read
    assert "affine: Obstacle 5" in read
    # Both are of one recording: curves not from the observer's estimates are shared.
    assert read.count("commanded") == 1
    chart.get_by_label("Commanded").uncheck()
    assert "commanded" not in _read_middle(page)
    keep_picture(page, "runs-overlaid")

    expect(chart.locator(".chart-note")).to_have_count(0)
    unaligned = {**_stored("still"), "aligned": False, "errors": [], "changes": []}
    unaligned["sentence"] = "not aligned yet: nothing moved"
    page.evaluate(_SHOW, [unaligned])
    expect(chart.locator(".chart-note")).to_have_text("Not aligned yet: nothing moved.")
    expect(chart.locator(".chart-errors")).to_contain_text("No speed errors: there is no ground")
    assert chart.locator(".chart-errors table").count() == 0


def test_live_curves_have_gaps_where_speeds_are_unknown(
    server: Server, open_panel: OpenPanel, free_port: int
) -> None:
    page = open_panel()
    told = page.evaluate(_LIVE)
    (coasted,), (dropped,) = told["gaps"]
    assert np.allclose([coasted["begin"], coasted["end"]], [1.85, 2.45])
    assert np.allclose([dropped["begin"], dropped["end"]], [3.9, 5.0])
    assert told["drop_out"] is None
    assert set(told["across"]) == {None}
    assert [change["words"] for change in told["changes"]] == ["3 → 5"]
    assert math.isclose(told["changes"][0]["time"], 7.0)
    assert math.isclose(told["first"], -0.05)
    assert math.isclose(told["upper"], 0.4 + 1.96 * 0.05)
    assert told["sent"] == {"speed": 0.5, "std": None}
    assert math.isclose(told["wheels_end"], 4.9)
    assert "Commanded cart" in told["labels"]

    note = page.locator("observer-speed-chart .chart-note")
    expect(note).to_be_hidden()
    truth = {"spec": f"vicon-udp:{free_port}", "observer": None, "ignore": []}
    server.api.put("/api/truth/live", json=truth).raise_for_status()
    try:
        expect(note).to_contain_text("Not aligned yet", timeout=10_000)
    finally:
        server.api.put("/api/truth/live", json={**truth, "spec": None}).raise_for_status()
    expect(note).to_be_hidden(timeout=10_000)

    page.locator("observer-speed-chart").get_by_role("button", name="Export").click()
    with page.expect_download() as saved:
        visible = page.get_by_role("group", name=re.compile("Visible curves"))
        visible.get_by_role("menuitem", name="Chart, CSV").click()
    assert "Ground truth" in saved.value.path().read_text()


def test_a_run_chart_is_saved_in_two_clicks(
    server: Server, open_panel: OpenPanel, eventually: Eventually
) -> None:
    wanted = {"name": "figure 17", "source": "simulated:lab", "record": "none"}
    run = server.api.post("/api/runs", json=wanted).raise_for_status().json()["id"]
    eventually(lambda: server.get(f"/runs/{run}")["frames"] >= 30, 30)
    server.api.post(f"/api/runs/{run}/stop").raise_for_status()
    page = open_panel()
    page.evaluate("run => { location.hash = `#runs/${run}`; }", run)
    # It is made by a separate process of the lowest priority.
    chart = page.locator("observer-run-chart:visible")
    expect(chart.locator(".uplot")).to_be_visible(timeout=60_000)
    expect(chart.locator(".chart-errors tbody tr").first).to_contain_text("Whole run")
    _see(page, 0.5, 1.5)
    export = page.locator("observer-run-export")
    export.get_by_role("button", name="Export").click()
    with page.expect_download(timeout=60_000) as saved:
        export.get_by_role("menuitem", name="Chart, CSV").click()
    rows = list(csv.DictReader(saved.value.path().read_text().splitlines()))
    assert {"estimate", "truth"} <= {row["source"] for row in rows}
    assert all(0.5 <= float(row["time_s"]) <= 1.5 for row in rows)
    expect(export.get_by_role("button", name="Export")).to_be_focused()
    server.api.delete(f"/api/runs/{run}").raise_for_status()


def test_curves_of_the_previous_source_are_cleared(server: Server, open_panel: OpenPanel) -> None:
    page = open_panel()
    chart = page.locator("observer-speed-chart")
    expect(chart.locator(".legend").last).to_contain_text("Ground truth P3-DX", timeout=20_000)
    try:
        server.api.put("/api/source", json={"source": "simulated:people"}).raise_for_status()
        expect(chart.locator(".legend").last).to_contain_text("Ada", timeout=20_000)
        expect(chart.get_by_text("P3-DX")).to_have_count(0)
    finally:
        server.api.put("/api/source", json={"source": "simulated:lab"}).raise_for_status()

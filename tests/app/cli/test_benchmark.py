"""``benchmark`` and ``evaluate`` as a shell sees them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from app.cli.results import FIGURE_SUFFIXES
from observer.figures import FORMATS

from .shell import Shell, in_a_process


def test_one_run_writes_json_markdown_and_figures(tmp_path: Path) -> None:
    folder, drawn = tmp_path / "new" / "results", tmp_path / "one.svg"
    done = in_a_process(
        "benchmark", "simulated:lateral", "--frames", "16", "--json",
        "--output", str(folder), "--figure", str(drawn),
    )  # fmt: skip
    assert done.code == 0, done.err
    assert {p.name for p in folder.iterdir()} == {
        "benchmark.json",
        "benchmark.md",
        "benchmark.png",
    }
    assert (folder / "benchmark.png").read_bytes().startswith(b"\x89PNG")
    assert drawn.read_text().startswith("<?xml")
    figures = json.loads((folder / "benchmark.json").read_text())
    assert figures == json.loads(done.out)
    assert figures["scale"] == "lab"
    for each in figures["presets"]:
        assert each["breakdown"]["by_kind"][0]["label"] == "ideal"
        assert each["timings_ms"]["total"]["median"] > 0
        assert each["opencv"]["ratio"] > 0
        assert {t["figure"] for t in each["targets"]} >= {"identity switches", "centre RMSE, m"}
    assert all("false_instances" in each for each in figures["sources"])
    text = (folder / "benchmark.md").read_text()
    for title in ("## Targets", "## Accuracy by range", "## By source", "## Cost"):
        assert title in text


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("--figure", "figure.gif"), "must end in .png, .svg, .pdf"),
        (("--figure", "/no/such/folder/figure.png"), "/no/such/folder"),
        (("--output", "/dev/null/x"), "/dev/null/x"),
        (("--jobs", "0"), "--jobs"),
    ],
)
def test_an_unwritable_output_is_refused_before_the_run(
    shell: Shell, arguments: tuple[str, ...], part: str
) -> None:
    done = shell("benchmark", "simulated:lateral", *arguments)
    assert (done.code, done.out) == (2, "")
    assert len(done.err.strip().splitlines()) == 1, done.err
    assert part in done.err


TRUTH = """frame,t,id,x,y,z,vx,vy,vz,visible,size_x,size_y,size_z,yaw
"""


def files(folder: Path) -> tuple[str, str]:
    """A body that crosses at 2.5 m with 0.3 m/s, reported 0.1 m/s too fast from the first frame."""
    rows, lines = [], []
    for k in range(20):
        t, x = k / 10, -0.3 + 0.03 * k
        rows.append(f"{k},{t},1,{x},0,2.5,0.3,0,0,1,0.45,0.38,0.24,1.5707963\n")
        obstacle = {
            "id": 4,
            "state": "confirmed",
            "motion": "moving",
            "position": [x, 0, 2.5],
            "velocity": [0.4, 0, 0],
            "speed": 0.4,
            "velocity_cov": None,
            "velocity_time": t,
        }
        ghost = obstacle | {"id": 9, "position": [x, 0, 6.0]}
        lines.append(
            {
                "frame": k,
                "time": t,
                "segment": 0,
                "status": "ok",
                "pose": {"position": [0, 0, 0], "orientation_wxyz": [1, 0, 0, 0]},
                "obstacles": [obstacle, ghost] if k == 5 else [obstacle],
            }
        )
    (folder / "truth.csv").write_text(TRUTH + "".join(rows))
    (folder / "tracks.jsonl").write_text("".join(json.dumps(each) + "\n" for each in lines))
    return str(folder / "tracks.jsonl"), str(folder / "truth.csv")


def test_every_format_of_figures_may_be_named() -> None:
    assert tuple(f".{name}" for name in FORMATS) == FIGURE_SUFFIXES


def test_evaluate_gives_the_same_breakdown_as_benchmark(shell: Shell, tmp_path: Path) -> None:
    tracks, truth = files(tmp_path)
    done = shell("evaluate", tracks, "--truth", truth, "--json")
    assert done.code == 0, done.err
    figures = json.loads(done.out)
    assert figures["speed_rmse_mps"] == pytest.approx(0.1)
    groups = {g["label"]: g for g in figures["breakdown"]["by_range"]}
    assert groups["2-3 m"]["count"] == figures["truth_count"] == 14
    assert groups["2-3 m"]["speed_rmse_mps"] == pytest.approx(0.1)
    (false,) = figures["false_instances"]
    assert (false["frame"], false["id"], false["range_m"]) == (5, 9, pytest.approx(6.0, abs=0.01))
    text = shell("evaluate", tracks, "--truth", truth).out
    assert "| recall | 1.000 |" in text
    assert "| 2-3 m | 14 | 1.000 | 0.100 | 0.100 |" in text
    assert "| lateral | 1 | 0 | 0.000 |" in text
    road = shell("evaluate", tracks, "--truth", truth, "--road").out
    assert "| < 10 m | 14 |" in road
    assert "| < 5 m/s | 14 |" in road


def test_calibration_option_excludes_source_and_figure(shell: Shell) -> None:
    done = shell("benchmark", "simulated:lateral", "--calibration")
    assert (done.code, done.out) == (2, "")
    assert "omit SOURCE and --figure" in done.err

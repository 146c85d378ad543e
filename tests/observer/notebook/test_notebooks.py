"""The notebooks run from first to last cell, in this process; a separate kernel takes seconds."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib
import msgspec
import nbformat
import numpy as np
import pytest

import observer
from observer.errors import ParameterError
from observer.recording.reader import Recording
from observer.recording.writer import RecordingWriter
from observer.types import StereoFrame

_NOTEBOOKS = Path(__file__).parents[3] / "notebooks"


@pytest.fixture(scope="session")
def recorded_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run with truth, as ``observe --record`` writes it."""
    from app.cli import main

    folder = tmp_path_factory.mktemp("recorded")
    with pytest.raises(SystemExit) as left:
        main(
            [
                "observe", "simulated:drive", "--frames", "14", "--record-images", "lossless",
                "--record", str(folder / "run.mcap"), "--output", str(folder / "run.jsonl"),
            ]
        )  # fmt: skip
    assert not left.value.code
    return folder / "run.mcap"


@pytest.fixture
def figures() -> Iterator[Any]:
    """Draw figures off screen and close them all afterwards."""
    before = matplotlib.get_backend()
    matplotlib.use("agg")
    from matplotlib import pyplot

    yield pyplot
    pyplot.close("all")
    matplotlib.use(before)


def run_notebook(name: str) -> dict[str, Any]:
    """Run all cells and return the variables they defined."""
    notebook = nbformat.read(_NOTEBOOKS / name, as_version=4)
    nbformat.validate(notebook)
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for k, cell in enumerate(notebook.cells):
        if cell.cell_type == "code":
            # Committed without outputs, which are large and differ each time.
            assert cell.outputs == []
            exec(compile(cell.source, f"{name}, cell {k}", "exec"), namespace)
    return namespace


def test_a_source_is_observed_with_parameters(
    figures: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    defined = run_notebook("observe_a_source.ipynb")
    steps = defined["steps"]
    assert len(steps) == 2 * defined["FRAMES"]
    # Switching to the affine model starts a new segment.
    assert {step.observation.segment for step in steps} == {0, 1}
    assert {step.observation.parameters_revision for step in steps} == {0, 1}
    assert any(step.obstacles for step in steps)
    assert "tracking.gate" in capsys.readouterr().out
    assert len(figures.get_fignums()) == 2


def test_a_run_is_analysed_against_truth(
    figures: Any,
    recorded_run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shutil.copy(recorded_run, tmp_path / "run.mcap")
    monkeypatch.chdir(tmp_path)
    defined = run_notebook("analyse_a_run.ipynb")
    assert "RMSE" in capsys.readouterr().out
    assert len(defined["rerun"]) == len(defined["run"])
    assert len(figures.get_fignums()) == 2


def test_tracks_match_the_lines_and_a_rerun_reproduces_them(recorded_run: Path) -> None:
    with observer.load(recorded_run) as run:
        rows = [(line, entry) for line in run for entry in line["obstacles"]]
        assert rows
        assert sum(len(track) for track in run.tracks) == len(rows)
        (track,) = [each for each in run.tracks if each.id == rows[0][1]["id"]]
        entries = [entry for _, entry in rows if entry["id"] == track.id]
        assert track.positions.tolist() == [entry["position"] for entry in entries]
        assert track.speeds.tolist() == [entry["speed"] for entry in entries]
        assert run.table("obstacles")["speed_mps"].tolist() == [e["speed"] for _, e in rows]
        pairs = run.speed_comparisons()
        assert pairs
        assert all(pair.rmse < 0.4 for pair in pairs)
        timeless = [{**line, "timings_ms": {}} for line in run]
        assert [{**line, "timings_ms": {}} for line in run.rerun()] == timeless
        with pytest.raises(ParameterError, match="has no effect"):
            run.rerun({"tracking.gate": 4.0})


def test_truth_is_matched_to_the_frames_of_its_own_engine(
    recorded_run: Path, tmp_path: Path
) -> None:
    black = np.zeros((8, 8), np.uint8)
    with Recording(recorded_run) as once:
        facts = msgspec.structs.replace(once.facts, images="none")
        writer = RecordingWriter(tmp_path / "twice.mcap", facts)
        lines = {line["frame"]: line for line in once.lines()}
        # Numbers and times begin again; the second engine's bodies are faster by 1 m/s.
        for segment in range(2):
            for matched in once.matched_truth():
                frame = once.frames[matched.frame]
                received = frame.received + 10.0 * segment
                writer.frame(StereoFrame(frame.index, frame.time, black, black, received))
                bodies = msgspec.to_builtins(matched.bodies)
                truth = [{**body, "speed": body["speed"] + segment} for body in bodies]
                line = {**lines[frame.index], "segment": segment}
                writer.observation(line, received, truth=truth)
        writer.finish()
    with observer.load(tmp_path / "twice.mcap") as run:
        first, second = run.speed_comparisons()
    assert (first.segment, second.segment) == (0, 1)
    np.testing.assert_allclose(second.true, first.true + 1.0)
    assert np.isfinite(first.true).any()


def test_a_picture_shows_the_observation_of_its_own_engine(
    recorded_run: Path, tmp_path: Path
) -> None:
    with Recording(recorded_run) as once:
        writer = RecordingWriter(tmp_path / "twice.mcap", once.facts)
        lines = {line["frame"]: line for line in once.lines()}
        shown = next(k for k, each in enumerate(once.frames) if lines[each.index]["obstacles"])
        # Numbers and times begin again, and the second engine sees nothing.
        changes: tuple[dict[str, Any], ...] = ({}, {"obstacles": []})
        for segment, changed in enumerate(changes):
            for position in range(shown - 1, shown + 1):
                frame, images = once.frames[position], once.pair(position)
                received = frame.received + 10.0 * segment
                writer.frame(StereoFrame(frame.index, frame.time, *images, received))
                writer.observation({**lines[frame.index], **changed, "segment": segment}, received)
        writer.finish()
    with observer.load(recorded_run) as run, observer.load(tmp_path / "twice.mcap") as twice:
        np.testing.assert_array_equal(twice.picture(1), run.picture(shown))
        assert (twice.picture(3) != twice.picture(1)).any()


def test_a_run_is_found_in_a_data_folder(recorded_run: Path, tmp_path: Path) -> None:
    folder = tmp_path / "runs" / "0af3"
    folder.mkdir(parents=True)
    shutil.copy(recorded_run, folder / "recording.mcap")
    with observer.load("0a", data=tmp_path) as run:
        assert len(run) == 14
    with pytest.raises(observer.errors.SourceError, match="no run 1"):
        observer.load("1", data=tmp_path)

"""Pictures of the chosen frame, and the reasons for those that cannot be made."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from matplotlib.figure import Figure

from app.reports import pictures
from app.reports.gathering import gather
from app.reports.moments import Moment, Moments, most_significant
from app.reports.report import Report
from app.reports.stereo_figure import stereo_figure, triangulated
from observer.recording.reader import Recording
from observer.recording.source import RecordingSource

from .conftest import record


@pytest.fixture(scope="module")
def own(recording: Path, report: Report) -> Iterator[Moment]:
    source = RecordingSource(recording)
    moments = Moments(source, report.gathered)
    position = moments.most_significant()
    assert position is not None
    moment = moments.own(position)
    assert moment is not None
    yield moment
    source.close()


def test_figure_12_states_the_depth_found_in_the_run(own: Moment) -> None:
    obstacle = most_significant(own.line)
    assert obstacle is not None
    found = triangulated(own, obstacle)
    assert found is not None
    u0, v0, u1, v1 = obstacle["box_px"]
    assert ((found.px >= (u0, v0)) & (found.px <= (u1, v1))).all()
    assert found.depth_m == pytest.approx(own.camera.fx * own.camera.baseline / found.disparity)
    assert found.centre is not None
    # The cameras see its front.
    assert 0.0 < found.centre[1] - found.depth_m < obstacle["size"][2]
    left, right, plan = stereo_figure(own, found).axes
    seen = {
        axes: next(line for line in axes.lines if line.get_marker() == "*")
        for axes in (left, right)
    }
    shift = np.asarray(seen[left].get_xdata()) - np.asarray(seen[right].get_xdata())
    assert shift == pytest.approx(found.disparities)
    assert f"{found.depth_m:.2f} m" in plan.get_title()


def test_one_camera_gives_neither_stereo_nor_cloud(own: Moment) -> None:
    parameters = own.parameters.changed({"ego_motion.model": "monocular"})
    one = replace(own, parameters=parameters)
    for make in (pictures._stereo, pictures._cloud):
        _, figure, missing = make(one)
        assert figure is None
        assert "used only the left camera" in missing


def test_figures_of_the_other_environment_are_explained_as_missing(
    report: Report, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = {number: ("words", Figure(), "") for number in pictures._TITLES}
    monkeypatch.setattr(pictures, "_made", lambda *_: dict(made))
    facts = msgspec.structs.replace(report.facts, source="camera:0,1", info={"kind": "camera"})
    found = pictures.pictures(Path("r.mcap"), report.gathered, facts, lambda *_: None)
    assert {each.number: each.missing for each in found if each.missing} == {
        "9": "The source of this run, camera:0,1, is not a simulator: figure 10 shows it.",
        "13": "The source of this run, camera:0,1, is not a simulator: figure 14 shows it.",
    }


def test_without_images_the_obstacle_is_shown_in_a_recorded_cloud(tmp_path: Path) -> None:
    path = record(tmp_path / "r.mcap", images="none", clouds=True)
    with Recording(path) as recording:
        gathered, facts = gather(recording), recording.facts

    def nothing(*_: Any) -> None:
        pass

    found = {each.number: each for each in pictures.pictures(path, gathered, facts, nothing)}
    assert [number for number, each in found.items() if each.figure is not None] == ["16"]
    frame = int(found["16"].caption.split()[1].rstrip(","))
    assert frame % 3 == 0
    assert "was not recorded" in found["16"].caption
    assert all("recorded without images" in each.missing for n, each in found.items() if n != "16")

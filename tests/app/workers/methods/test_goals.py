"""The goal at each frame of a recorded run, and why the robot behaved as it did."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from app.contract.robots import GoalNow
from app.contract.values import plain
from app.workers.methods.frames import run_frames
from observer.calibration.formats.opencv_file import calibration_text
from observer.navigation.plan import RefusedPath
from observer.opening import open_source
from observer.recording.payloads import RobotRow, RunFacts
from observer.recording.reader import Recording
from observer.recording.writer import RecordingWriter
from observer.types import StereoFrame

_RATE_HZ = 10
_GOAL = GoalNow(
    state="driving",
    sentence="Passing behind obstacle 3.",
    place=(2.0, -0.5),
    distance_m=2.06,
    elapsed_s=1.0,
    path=[(0.1, 0.0), (0.5, 0.1)],
    risk_per_metre=0.001,
    planned_risk_per_metre=2e-5,
    waits_for=3,
    meets_s=1.4,
    meets_at=(1.0, 0.0),
    refused=[RefusedPath(0.0, 0.5, ((0.1, 0.0), (2.0, 0.0)), "risk", 0.04, 3, 1.2)],
)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight frames: no goal, driving to one, its end, an old version's report, no usable report."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    source = open_source("simulated:drive").source
    assert source.calibration is not None
    facts = RunFacts(
        id="run",
        name="a run",
        source=source.info.spec,
        info={},
        calibration_yaml=calibration_text(source.calibration),
        images="none",
    )
    told = [
        *(None, plain(_GOAL), plain(replace(_GOAL, elapsed_s=1.1))),
        plain(replace(_GOAL, state="reached", refused=[], meets_at=None)),
        {
            name: value
            for name, value in plain(_GOAL).items()
            if name not in ("refused", "meets_at")
        },
        {"state": "on its way"},
    ]
    writer = RecordingWriter(path, facts)
    for k in range(8):
        frame = source.read()
        assert isinstance(frame, StereoFrame)
        received = 50.0 + k / _RATE_HZ + (5.0 if k == 7 else 0.0)
        writer.frame(replace(frame, received=received))
        if k < len(told):
            for role, goal in (("observer", told[k]), ("obstacle", None)):
                row = RobotRow(role=role, received=received + 0.02, facts={"goal": goal})
                writer.robot(row)
    source.close()
    writer.flush(1e9)
    writer.finish()
    return path


def test_each_frame_has_the_goal_of_its_time(recording: Path) -> None:
    with Recording(recording) as opened:
        goals = [entry.goal for entry in run_frames(opened, None).frames]
    assert goals[:3] == [None, _GOAL, replace(_GOAL, elapsed_s=1.1)]
    assert goals[3] is not None
    assert (goals[3].state, goals[3].refused) == ("reached", [])
    # From an older version.
    assert goals[4] == replace(_GOAL, refused=(), meets_at=None)
    # Reports that cannot be read, and those that are too old.
    assert goals[5:] == [None, None, None]

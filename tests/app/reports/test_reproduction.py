"""Driving the experiments of figure 17, again where the robots were stopped."""

from __future__ import annotations

from collections.abc import Container, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from fastapi import HTTPException
from fastapi.responses import Response

from app.client.server_process import RunningServer
from app.reports import reproduction
from app.reports.reproduction import ReproductionError, play_experiments
from observer.motion_profiles.profile import MotionProfile
from observer.motion_profiles.profile_file import profile_from_text

from ..cli.scripted_server import MINE, TOKEN, ScriptedServer, running
from ..cli.shell import Shell

RECORDED = b"what was recorded"
LATE = "no camera frame for 200 ms"


class Laboratory(ScriptedServer):
    """A scripted server that also keeps runs.

    Attributes:
        runs: their ids, in order; a new one begins when none is going. going: the current one.
        late: which drives are stopped, counted from 0.
        looks: how often the facts were requested. incidents: what stopped robots.
    """

    def __init__(self) -> None:
        super().__init__()
        self.runs: list[str] = []
        self.going: str | None = None
        self.late: Container[int] = ()
        self.looks = 0
        self.incidents: list[dict[str, Any]] = []
        self.act = self._maybe_late
        self._run_routes()

    @property
    def drives(self) -> int:
        """Return how many drives were started."""
        return self.calls.count(("POST", "/robots/programme"))

    def facts(self) -> dict[str, Any]:
        self.looks += 1
        # As if the machine was busy at first, but no longer once its load is checked.
        return {
            **super().facts(),
            "sight": {"age_s": 0.3 if self.looks < 5 else 0.04},
            "incidents": self.incidents,
        }

    def _maybe_late(self, since_s: float) -> None:
        if self.drives - 1 in self.late and since_s > 0.1:
            self.incidents = [
                {"kind": "programme", "sentence": f"the programme mine was stopped: {LATE}"},
                {"kind": "sight", "sentence": LATE},
            ]
            self.end(None)

    def _run_routes(self) -> None:
        @self.app.get("/api/status")
        async def status() -> Any:
            return {"frames_observed": 7}

        @self.app.post("/api/runs")
        async def start(body: dict[str, str]) -> Any:
            if self.going is not None:
                raise HTTPException(409, "a run is going on")
            assert body["record"] == "lossless"
            self.why = dict.fromkeys(self.why)
            self.going = f"run-{len(self.runs)}"
            self.runs.append(self.going)
            return {"id": self.going}

        @self.app.post("/api/runs/{id}/stop")
        async def stop(id: str) -> Any:
            assert id == self.going
            self.going = None
            return {}

        @self.app.get("/api/runs/{id}/recording")
        async def recording(id: str) -> Any:
            assert id == self.runs[-1]
            assert self.going is None
            return Response(RECORDED)


@pytest.fixture
def laboratory(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Laboratory:
    """Replace our own server by the script, and skip waits for robots to rest."""
    script = Laboratory()

    @contextmanager
    def serving(source: str) -> Iterator[RunningServer]:
        assert source == "simulated:drive"
        with running(script):
            yield RunningServer(script.port, TOKEN, 0.0, 0, tmp_path)

    monkeypatch.setattr(reproduction, "running_server", serving)
    for name in ("_REST_S", "_CROSSES_S", "_CALM_S"):
        monkeypatch.setattr(reproduction, name, 0.01)
    return script


@pytest.fixture
def mine() -> MotionProfile:
    return profile_from_text(MINE)


def test_both_experiments_are_repeated_when_the_robots_were_stopped(
    laboratory: Laboratory, mine: MotionProfile, tmp_path: Path
) -> None:
    laboratory.late = {0, 2}
    said: list[str] = []
    path = tmp_path / "recording.mcap"
    played = play_experiments(path, (mine, mine), tell=said.append)
    # Stopped in the first run, in the second after its first drive; the third drives the rest.
    assert laboratory.runs == ["run-0", "run-1", "run-2"]
    assert laboratory.drives == 5
    assert path.read_bytes() == RECORDED
    first, second = played.experiments
    assert 0.8 <= first.ended - first.began < 20.0
    assert first.ended <= second.began
    assert [LATE in why for why in played.interrupted] == [True, True]
    driving, (first_why, second_why) = "driving mine, 1 s", played.interrupted
    assert said == [
        driving, f"attempt 1 of 24: {first_why}",
        driving, driving, f"attempt 2 of 24: {second_why}",
        driving, driving,
    ]  # fmt: skip
    assert laboratory.armed == set()
    # The obstacle is armed by itself before each run's drives.
    arms = [call[1] for call in laboratory.calls if call[1].endswith("/arm")]
    alone, both = ["/robots/obstacle/arm"], ["/robots/observer/arm", "/robots/obstacle/arm"]
    assert arms == [*alone, *both, *alone, *both, *both, *alone, *both, *both]


def test_a_later_drive_stopped_early_restarts_in_place(
    laboratory: Laboratory, mine: MotionProfile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Everything that is driven in this test counts as the gesture.
    monkeypatch.setattr(reproduction, "_BEHIND_S", -9.0)
    laboratory.late = {0, 2}
    played = play_experiments(tmp_path / "r.mcap", (mine, mine), tell=lambda _: None)
    assert laboratory.runs == ["run-0", "run-1"]
    assert laboratory.drives == 4
    assert len(played.interrupted) == 2
    first, second = played.experiments
    assert second.began - first.ended > 0.2


def test_a_reproduction_gives_up_after_the_maximum_attempts(
    laboratory: Laboratory, mine: MotionProfile, tmp_path: Path
) -> None:
    laboratory.late = range(99)
    with pytest.raises(ReproductionError, match=f"in each of 2 attempts.*{LATE}"):
        play_experiments(tmp_path / "r.mcap", (mine,), tell=lambda _: None, attempts=2)
    assert len(laboratory.runs) == 2
    assert laboratory.going is None
    assert list(tmp_path.iterdir()) == []


def test_an_unwritable_folder_is_reported_before_driving(
    laboratory: Laboratory, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("in the way")
    done = Shell(capsys)("reproduce", "--output", str(tmp_path / "file" / "folder"))
    assert done.code == 2
    assert "cannot write" in done.err
    assert laboratory.calls == []

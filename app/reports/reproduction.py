"""Reproduction of both experiments of figure 17 in the simulated lab: drive, record, report.

Our own server and its drive process do everything, as they would for a person at the page; nothing
here knows more than the page does.
"""

from __future__ import annotations

import contextlib
import shutil
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.client.operator_socket import OperatorSocket
from app.client.profile_drive import PlayRequest, ProfileDrive
from app.client.server_api import DrivingFailed, ServerApi
from app.client.server_process import RunningServer, running_server
from app.reports.experiments import Experiment, judged, with_experiments
from app.reports.gathering import Gathered
from app.reports.report import Report, make_report
from app.reports.report_figure import Step
from observer.errors import DynamicObserverError
from observer.guard.sight import SIGHT_FRESH_S
from observer.motion_profiles.gesture import GESTURE_S
from observer.motion_profiles.playing import duration_s
from observer.motion_profiles.profile import MotionProfile
from observer.whole_files import whole_file

SOURCE = "simulated:drive"
ATTEMPTS = 24
_DOWNLOAD_TIMEOUT_S = 120.0
# Until its motors first switch on, the obstacle follows its own course across the view; after this
# long, half of its path lies to either side.
_CROSSES_S = 2.4
# Time until a track has ended.
_REST_S = 2.0
# A drive begins after frames were on time for this long, or after the maximum wait.
_CALM_S = 3.0
_CALM_WITHIN_S = 60.0
# Fraction of the age that stops a robot, SIGHT_FRESH_S.
_CALM_SHARE = 0.7
_LOOK_S = 0.05
# A drive may be this much further than last reported.
_BEHIND_S = 0.5


class ReproductionError(DynamicObserverError):
    """Failure to carry out the experiments."""


@dataclass(frozen=True)
class Played:
    """Recording of the experiments that were driven.

    Attributes:
        recording: of one run.
        experiments: in the order in which they were driven.
        interrupted: the reasons why earlier attempts ended prematurely, one sentence each.
    """

    recording: Path
    experiments: tuple[Experiment, ...]
    interrupted: tuple[str, ...]


def play_experiments(
    recording: Path,
    programmes: Sequence[MotionProfile],
    *,
    tell: Callable[[str], None],
    attempts: int = ATTEMPTS,
) -> Played:
    """Serve the lab, drive one programme after another in one run, and fetch its recording.

    It is one run because the second experiment begins where the first one ends. On a machine too
    busy to deliver frames in time, the robots are stopped, as they must be. A later experiment that
    had hardly begun is then restarted on the spot; otherwise everything is driven again in another
    run, which begins with the world in its initial state.

    Args:
        programmes: of the server's library, by their names.
        tell: receives a sentence for people at each step.
        attempts: maximum number of drives that may end prematurely, in all.

    Raises:
        MeasurementError: the server did not start, or refused a run.
        ReproductionError: the programmes were never driven to their end, or the recording could not
            be fetched.
    """
    tries = _Attempts(attempts, tell)
    with running_server(SOURCE) as server:
        server.wait_for_frames()
        while True:
            started = server.request(
                "POST", "/api/runs", {"name": "Figure 17, both experiments", "record": "lossless"}
            )
            try:
                experiments = _driven(server, programmes, tries)
            except DrivingFailed as error:
                tries.ended(error)
                continue
            finally:
                server.request("POST", f"/api/runs/{started['id']}/stop")
            _fetch(server, str(started["id"]), recording)
            return Played(recording, experiments, tuple(tries.reasons))


def reproduction_report(played: Played, published: Gathered, progress: Step) -> Report:
    """Make the paper's figures from the recording, and each experiment by both methods.

    Args:
        published: the same frames by the published method, from ``observed_as_published``.

    Raises:
        SourceError: it is no recording, or holds no images.
    """
    report = make_report(played.recording, progress)
    methods = ((report.gathered, "rigid, as in the run"), (published, "affine, as published"))
    found = tuple(
        judged(played.recording, gathered, experiment, method)
        for experiment in played.experiments
        for gathered, method in methods
    )
    return with_experiments(report, found)


class _Attempts:
    """Counter of drives that ended prematurely; reports each."""

    def __init__(self, most: int, tell: Callable[[str], None]) -> None:
        self._most = most
        self.tell = tell
        self.reasons: list[str] = []

    def ended(self, error: DrivingFailed) -> None:
        """Count one and report it.

        Raises:
            ReproductionError: no further attempt is allowed.
        """
        self.reasons.append(str(error))
        self.tell(f"attempt {len(self.reasons)} of {self._most}: {error}")
        if len(self.reasons) == self._most:
            raise ReproductionError(
                f"the robots were stopped in each of {self._most} attempts, most recently because "
                f"{error}; try again when this computer is less busy"
            )


def _driven(
    server: RunningServer, programmes: Sequence[MotionProfile], tries: _Attempts
) -> tuple[Experiment, ...]:
    """Drive all programmes; return their experiments.

    Raises:
        DrivingFailed: something stopped the robots at a point where driving cannot go on.
    """
    server.wait_for_frames()
    time.sleep(_CROSSES_S)
    experiments: list[Experiment] = []
    with contextlib.closing(ServerApi(f"http://127.0.0.1:{server.port}", server.token)) as api:
        _halt_obstacle(api)
        left = list(programmes)
        while left:
            programme = left[0]
            _wait_for_calm(api)
            tries.tell(f"driving {programme.name}, {duration_s(programme):.0f} s")
            request = PlayRequest(
                programme.name, programme.roles, duration_s(programme), 1, False, False
            )
            drive = ProfileDrive(api, request, lambda *_: None)
            # The server's processes use the same monotonic clock as this one.
            began = time.monotonic()
            try:
                drive.run()
            except DrivingFailed as error:
                # The gesture ends where it begins.
                gesture_s = GESTURE_S if programme.gesture else 0.0
                if not experiments or drive.summary()["elapsed_s"] >= gesture_s - _BEHIND_S:
                    raise
                tries.ended(error)
                continue
            experiments.append(Experiment(programme.title, began, time.monotonic()))
            left.pop(0)
            time.sleep(_REST_S)
    return tuple(experiments)


def _halt_obstacle(api: ServerApi) -> None:
    """End the obstacle's own course by arming it once; it then stands until it is driven."""
    with OperatorSocket(api) as socket:
        lease = socket.take("obstacle", takeover=False)
        api.post("robots", "obstacle", "arm", body={"lease": lease})
        socket.release()


def _wait_for_calm(api: ServerApi) -> None:
    """Wait until frames come on time, so that a short burst of load does not end a drive."""
    began = calm_since = time.monotonic()
    while (now := time.monotonic()) - began < _CALM_WITHIN_S and now - calm_since < _CALM_S:
        age = api.get("robots")["sight"]["age_s"]
        if age is None or age > _CALM_SHARE * SIGHT_FRESH_S:
            calm_since = now
        time.sleep(_LOOK_S)


def _fetch(server: RunningServer, run_id: str, path: Path) -> None:
    """Download the recording of a run.

    Raises:
        ReproductionError: it could not be read or written.
    """
    request = urllib.request.Request(
        f"http://127.0.0.1:{server.port}/api/runs/{run_id}/recording",
        headers={"Authorization": f"Bearer {server.token}"},
    )
    try:
        with (
            urllib.request.urlopen(request, timeout=_DOWNLOAD_TIMEOUT_S) as answer,  # nosec B310
            whole_file(path) as part,
            part.open("wb") as file,
        ):
            shutil.copyfileobj(answer, file)
    except (urllib.error.URLError, OSError) as error:
        raise ReproductionError(f"the recording could not be fetched: {error}") from None

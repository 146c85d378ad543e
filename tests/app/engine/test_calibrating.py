"""Calibration in the engine's loop: a board held in several places before two cameras."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pytest

from app.contract.calibrating import BoardLook
from app.contract.commands import (
    BeginCalibration,
    ChangeCalibration,
    CloseSource,
    PreviewCalibration,
    SetParameters,
    TakeScenePairs,
)
from app.contract.events import (
    BoardLookEvent,
    BoardViewsEvent,
    EngineState,
    HeartbeatEvent,
    ObservationEvent,
    StateEvent,
)
from app.engine import calibrating
from observer.calibration.boards.board import Board, BoardSighting
from observer.calibration.boards.board_pictures import draw_board, small_picture
from observer.calibration.boards.detection import detect_board
from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration
from observer.sources.contract import SourceInfo
from observer.types import StereoFrame

from .bench import Bench, opening

BOARD = Board("chessboard", 9, 6, 0.025)
SIZE = (320, 240)
RATE = 30.0
SQUARE_PX = 18
SHIFT_PX = 12
# Upper left inner corner in the left image; None: the board is put down.
LEFT, RIGHT, AWAY = (30.0, 40.0), (140.0, 100.0), None


def picture(corner: tuple[float, float] | None, side: int) -> np.ndarray:
    """Return (H, W) uint8: a board that faces the camera, with its first inner corner there."""
    image = np.full(SIZE[::-1], 150, np.uint8)
    if corner is None:
        return image
    squares = np.add.outer(np.arange(BOARD.rows + 3), np.arange(BOARD.columns + 3)) % 2 == 0
    squares[[0, -1]] = squares[:, [0, -1]] = False
    drawn = np.where(np.kron(squares, np.ones((SQUARE_PX, SQUARE_PX))), 30, 230).astype(np.uint8)
    # An inner corner lies between four pixels.
    at = np.array(corner) - (SHIFT_PX * side, 0) - 2 * SQUARE_PX + 0.5
    put = np.array([[1.0, 0, at[0]], [0, 1.0, at[1]]])
    shown = cv2.warpAffine(drawn, put, SIZE, dst=image, borderMode=cv2.BORDER_TRANSPARENT)
    return np.asarray(cv2.GaussianBlur(shown, (0, 0), 0.7), np.uint8)


@dataclass
class BoardSource:
    """Frames in which the board is held at each place for some frames, then at the next."""

    places: list[tuple[float, float] | None]
    hold: int = 20
    closed: int = 0
    at: int = 0

    @property
    def info(self) -> SourceInfo:
        return SourceInfo("board", "drawn", *SIZE, RATE, self.hold * len(self.places))

    @property
    def calibration(self) -> StereoCalibration | None:
        return None

    def read(self) -> StereoFrame | None:
        index = self.at
        if index >= self.info.frame_count:
            return None
        self.at += 1
        place = self.places[index // self.hold]
        left, right = picture(place, 0), picture(place, 1)
        return StereoFrame(index, index / RATE, left, right, received=-1.0)

    def rewind(self) -> None:
        self.at = 0

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def bench(numbered: Any) -> Iterator[Bench]:
    made = Bench()
    made.sources["board"] = BoardSource([LEFT, RIGHT, AWAY])
    made.sources["held"] = BoardSource([LEFT])
    made.sources["none"] = BoardSource([AWAY])
    made.sources["many"] = numbered(10_000)
    with made:
        yield made


def begin(source: str = "board", **more: Any) -> BeginCalibration:
    return BeginCalibration(source, BOARD, **more)


def looks(bench: Bench) -> list[BoardLook]:
    return [event.look for event in bench.all(BoardLookEvent)]


def count_after(bench: Bench, kind: type, seconds: float) -> int:
    bench.forget()
    time.sleep(seconds)
    return len(bench.all(kind))


def test_new_poses_are_captured_and_reported_with_thumbnails(bench: Bench) -> None:
    value = bench.value(begin())
    assert (value.state.state, value.state.camera, value.state.run_id) == (
        "calibrating",
        None,
        None,
    )
    assert (value.state.source.width, value.state.source.height) == SIZE
    second = bench.wait(BoardViewsEvent, lambda event: event.names == ("1", "2"))
    first = bench.wait(BoardViewsEvent)
    assert first.names == ("1",)
    # Ground truth by construction: the corners are where the squares meet.
    for event, place in ((first, LEFT), (second, RIGHT)):
        view = event.added
        grid = BOARD.object_points[:, :2] / BOARD.square_m * SQUARE_PX
        for seen, shift in ((view.left, 0), (view.right, SHIFT_PX)):
            truth = grid + np.array(place) - (shift, 0)
            assert np.abs(seen.px - truth).max() < 0.15
        for jpeg in event.pictures:
            small = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
            assert small.shape == (120, 160, 3)
    look = bench.wait(BoardLookEvent, lambda event: event.look.seen == [0, 0]).look
    assert "to both cameras" in look.words
    assert look.views == 2
    seen = next(each for each in looks(bench) if each.views == 1 and each.seen == [54, 54])
    assert all(0 <= bar <= 1 for bar in seen.coverage.values())
    assert not seen.enough
    assert not bench.all(ObservationEvent)
    assert bench.state.state is EngineState.CALIBRATING


def test_published_images_show_the_detected_board(bench: Bench) -> None:
    bench.value(begin("held"))
    bench.wait(BoardViewsEvent)
    bench.forget()
    bench.wait(BoardLookEvent)
    frame, left, right = bench.publisher.shown
    assert frame.left.shape == SIZE[::-1]
    for side, image in enumerate((left, right)):
        assert image.shape == (*SIZE[::-1], 3)
        corner = tuple(round(x) for x in np.array(LEFT) - (SHIFT_PX * side, 0))
        # Its first corner is a green dot on black and white.
        b, g, r = image[corner[1], corner[0]].tolist()
        assert g > b + 50
        assert g > r + 50


def test_without_automatic_capture_only_requested_views_are_taken(bench: Bench) -> None:
    bench.value(begin("held", automatic=False))
    bench.wait(BoardLookEvent, lambda event: event.look.frame > 25)
    assert not bench.all(BoardViewsEvent)
    assert bench.value(ChangeCalibration(capture=True)) == ("1",)
    assert bench.wait(BoardViewsEvent).added.name == "1"
    # A manual capture also takes a pose that is not new.
    assert bench.value(ChangeCalibration(capture=True)) == ("1", "2")
    assert bench.value(ChangeCalibration(automatic=True)) == ("1", "2")
    bench.forget()
    assert bench.wait(BoardLookEvent).look.automatic is True


def test_without_a_board_capture_is_refused_and_changes_nothing(bench: Bench) -> None:
    refused = bench.answer(ChangeCalibration(capture=True))
    assert (refused.refusal, refused.error) == (
        "state",
        "no calibration is in progress; start one first",
    )
    bench.value(begin("none"))
    bench.wait(BoardLookEvent, lambda event: event.look.frame > 3)
    for command, words in (
        (ChangeCalibration(capture=True, automatic=False), "not visible to both cameras right now"),
        (ChangeCalibration(undo=True, automatic=False), "no view to undo"),
        (ChangeCalibration(remove="7", cover_check=True), "there is no view '7'"),
    ):
        refused = bench.answer(command)
        assert refused.refusal == "state"
        assert words in (refused.error or "")
    bench.forget()
    look = bench.wait(BoardLookEvent).look
    assert (look.automatic, look.cover_asked) == (True, False)
    assert not bench.all(BoardViewsEvent)


def test_restored_views_still_count_and_can_be_undone(bench: Bench) -> None:
    bench.value(begin("held"))
    view = bench.wait(BoardViewsEvent).added
    bench.forget()
    bench.value(begin("held", views=(view,)))
    # The pose counts as known, although this collector never saw it.
    bench.wait(BoardLookEvent, lambda event: event.look.frame > 25)
    assert not bench.all(BoardViewsEvent)
    assert bench.value(ChangeCalibration(capture=True)) == ("1", "2")
    assert bench.value(ChangeCalibration(remove="1")) == ("2",)
    told = bench.wait(BoardViewsEvent, lambda event: event.names == ("2",))
    assert (told.added, told.pictures) == (None, None)
    assert bench.value(ChangeCalibration(undo=True)) == ()
    # A view that was undone is not captured again at once.
    time.sleep(0.6)
    assert bench.all(BoardViewsEvent)[-1].names == ()


def test_the_covered_lens_is_reported_while_a_cover_check_is_active(bench: Bench) -> None:
    source = BoardSource([LEFT], hold=2000)
    plain_read = source.read
    covered = {"left": False}

    def read() -> StereoFrame | None:
        frame = plain_read()
        if frame is not None and covered["left"]:
            dark = np.full_like(frame.left, 5)
            return StereoFrame(frame.index, frame.time, dark, frame.right, received=-1.0)
        return frame

    source.read = read  # type: ignore[method-assign]
    bench.sources["covered"] = source
    bench.value(begin("covered"))
    bench.wait(BoardLookEvent, lambda event: event.look.frame > 8)
    bench.value(ChangeCalibration(cover_check=True))
    covered["left"] = True
    told = bench.wait(BoardLookEvent, lambda event: event.look.covered is not None)
    assert told.look.covered == "left"
    bench.value(ChangeCalibration(cover_check=False))
    bench.forget()
    look = bench.wait(BoardLookEvent).look
    assert (look.covered, look.cover_asked) == (None, False)


def test_another_calibration_or_source_replaces_the_current_one(bench: Bench) -> None:
    board, held = bench.sources["board"], bench.sources["held"]
    bench.value(begin())
    bench.value(begin("held"))
    assert (board.closed, held.closed) == (1, 0)
    assert bench.state.source is not None
    bench.value(opening("many"))
    assert held.closed == 1
    assert bench.state.state is EngineState.PREVIEW
    bench.wait(ObservationEvent)
    assert count_after(bench, BoardLookEvent, 0.2) == 0


def test_the_open_source_stays_when_the_cameras_cannot_be_opened(bench: Bench) -> None:
    bench.value(opening("many"))
    refused = bench.answer(begin("missing"))
    assert refused.refusal == "input"
    assert "there is no missing" in (refused.error or "")
    assert bench.state.state is EngineState.PREVIEW
    assert count_after(bench, ObservationEvent, 0.3) > 0
    bench.value(begin("held"))
    bench.wait(BoardViewsEvent)
    assert bench.answer(begin("missing")).refusal == "input"
    assert bench.value(ChangeCalibration(capture=True)) == ("1", "2")
    bench.value(CloseSource())
    refused = bench.answer(begin("missing"))
    assert bench.state.state is EngineState.FAILED
    assert bench.state.reason == refused.error


def test_a_calibration_is_refused_during_a_run(bench: Bench) -> None:
    bench.value(opening("many", run_id="r1"))
    refused = bench.answer(begin("held"))
    assert refused.refusal == "state"
    assert "a run is in progress" in (refused.error or "")
    assert bench.state.state is EngineState.RUNNING


def test_commands_for_the_observer_are_refused_or_deferred(bench: Bench) -> None:
    bench.value(begin("held"))
    refused = bench.answer(TakeScenePairs())
    assert refused.refusal == "state"
    assert bench.value(SetParameters({}, 3)) is None
    bench.wait(BoardLookEvent)
    # A calibration result is previewed on the cameras that are being calibrated.
    text = calibration_text(StereoCalibration.rectified(*SIZE, 300.0, 300.0, 159.5, 119.5, 0.1))
    preview = bench.value(PreviewCalibration(text))
    assert preview.jpeg.startswith(b"\xff\xd8")
    assert preview.vertical_error_px < 0.5


def test_a_failed_board_search_does_not_end_the_calibration(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = detect_board
    fails = itertools.chain([False, True], itertools.repeat(False))

    def moody(*given: Any, **more: Any) -> Any:
        if next(fails):
            raise cv2.error("assertion failed")
        return plain(*given, **more)

    monkeypatch.setattr(calibrating, "detect_board", moody)
    bench.value(begin("held"))
    told = bench.wait(BoardLookEvent, lambda event: event.look.frame is None)
    assert told.look.words.startswith("Board detection failed: ")
    bench.wait(BoardLookEvent, lambda event: (event.look.frame or 0) > 5)
    assert bench.state.state is EngineState.CALIBRATING


def test_heartbeats_continue_during_board_search(bench: Bench) -> None:
    bench.value(begin("none"))
    beats = count_after(bench, HeartbeatEvent, 1.0)
    # The engine sends 20/s and promises 10/s; this machine may be busy.
    assert beats >= 8
    assert len(bench.all(StateEvent)) < 10


def test_leaving_closes_the_source() -> None:
    made = Bench()
    source = made.sources["held"] = BoardSource([LEFT])
    with made:
        made.value(begin("held"))
    assert source.closed == 1


# --- pictures -------------------------------------------------------------------------------


def sighting(px: np.ndarray) -> BoardSighting:
    return BoardSighting(np.arange(len(px), dtype=np.int32), px.astype(float))


def test_drawing_leaves_the_image_unchanged_and_handles_points_outside() -> None:
    image = picture(LEFT, 0)
    before = image.copy()
    px = BOARD.object_points[:, :2] / BOARD.square_m * SQUARE_PX + LEFT
    ghost = np.array([[-1e9, -50.0], [1e9, -50.0], [400.0, 300.0], [-30.0, 300.0]])
    drawn = draw_board(image, BOARD, sighting(px), [sighting(px + 5000)], ghost)
    assert drawn.shape == (*image.shape, 3)
    assert (image == before).all()
    assert (drawn != cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)).any()
    plain = draw_board(image, BOARD, None, (), None)
    assert (plain == cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)).all()


def test_captured_views_and_the_target_pose_are_drawn_in_place() -> None:
    image = np.full((240, 320, 3), 100, np.uint8)
    kept = sighting(np.array([[20.0, 20], [100, 20], [100, 100], [20, 100]]))
    ghost = np.array([[200.0, 150], [300, 150], [300, 220], [200, 220]])
    drawn = draw_board(image, BOARD, None, [kept], ghost).astype(int)
    changed = np.abs(drawn - 100).max(axis=2) > 5
    assert changed[60, 60]
    assert changed[185, 250]
    assert not changed[200, 60]
    # The outline of the target pose stands out from its area.
    assert np.abs(drawn[150, 250] - drawn[185, 250]).max() > 40


def test_a_thumbnail_shows_the_corners_in_the_right_place() -> None:
    image = np.full((480, 640), 100, np.uint8)
    box = sighting(np.array([[100.0, 100], [500, 100], [500, 300], [100, 300]]))
    small = cv2.imdecode(np.frombuffer(small_picture(image, box), np.uint8), cv2.IMREAD_COLOR)
    assert small.shape == (120, 160, 3)
    green = small[..., 1].astype(int) - small[..., 2] > 40
    rows, columns = np.nonzero(green)
    assert (rows.min(), rows.max()) == pytest.approx((25, 75), abs=2)
    assert (columns.min(), columns.max()) == pytest.approx((25, 125), abs=2)
    assert len(small_picture(image, box)) < 8000

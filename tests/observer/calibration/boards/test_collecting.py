import cv2
import numpy as np
import pytest

from observer.calibration.boards.board import Board, BoardSighting
from observer.calibration.boards.collecting import Look, ViewCollector
from observer.errors import CalibrationError

from .drawn_boards import SIZE, camera_matrix, seen_by

BOARD = Board()
FACING = np.zeros(3)
MIDDLE = np.array([-0.1, -0.0625, 0.6])


class Rig:
    """Two cameras side by side that see a board, with lenses unknown to the collector."""

    def __init__(
        self, board: Board = BOARD, focal: float = 500.0, baseline: float = 0.08, seed: int = 0
    ) -> None:
        self.board = board
        self.camera = camera_matrix(focal)
        self.distortion = np.array([-0.1, 0.02, 0.0, 0.0])
        self.baseline = baseline
        self.rng = np.random.default_rng(seed)

    def see(
        self, turn: np.ndarray, place: np.ndarray
    ) -> tuple[BoardSighting | None, BoardSighting | None]:
        shift = np.array([self.baseline, 0.0, 0.0])
        lens = self.camera, self.distortion, self.rng
        return (
            seen_by(self.board, turn, place, *lens),
            seen_by(self.board, turn, place - shift, *lens),
        )

    def follow(self, ghost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where a person holds the board for an outline: off by 4 degrees and a few %."""
        step = self.board.square_m
        width, height = self.board.columns * step, self.board.rows * step
        edge = np.array([[-step, -step], [width, -step], [width, height], [-step, height]])
        _, turn, place = cv2.solvePnP(
            np.column_stack([edge, np.zeros(4)]),
            ghost,
            self.camera,
            self.distortion,
            flags=cv2.SOLVEPNP_IPPE,
        )
        rotation = cv2.Rodrigues(turn)[0]
        middle = np.array([(width - step) / 2, (height - step) / 2, 0.0])
        there = rotation @ middle + place.ravel()
        there = there * (1 + self.rng.normal(0, 0.04))
        there[:2] += self.rng.normal(0, 0.02, 2) * there[2]
        rotation = cv2.Rodrigues(self.rng.normal(0, np.deg2rad(4), 3))[0] @ rotation
        return cv2.Rodrigues(rotation)[0].ravel(), there - rotation @ middle


def hold(
    collector: ViewCollector, rig: Rig, place: np.ndarray, start: float, turn: np.ndarray = FACING
) -> list[Look]:
    """Half a second of the board at rest."""
    return [collector.look(*rig.see(turn, place), start + 0.1 * k) for k in range(6)]


def test_new_pose_is_captured_once_held_still() -> None:
    collector = ViewCollector(BOARD, SIZE)
    looks = hold(collector, Rig(), MIDDLE, 10.0)
    captured = [k for k, look in enumerate(looks) if look.view]
    assert captured == [3]
    assert looks[0].words == "Hold the board still"
    assert looks[0].still is None
    assert looks[3].words == "Captured 1"
    assert looks[3].still is True
    assert looks[4].words.startswith("Already captured: ")
    assert [view.name for view in collector.views] == ["1"]
    view = collector.views[0]
    assert len(view.left.common_px(view.right)[0]) == BOARD.corner_count


def test_moving_board_is_not_captured() -> None:
    collector, rig = ViewCollector(BOARD, SIZE), Rig()
    # 8 cm a second at 0.6 m: 67 pixels a second.
    for k in range(20):
        look = collector.look(*rig.see(FACING, np.add(MIDDLE, (0.008 * k - 0.08, 0, 0))), 0.1 * k)
        assert not look.view
    assert look.still is False
    assert look.words == "Hold the board still"


def test_slow_motion_blocks_capture_only_when_camera_skew_is_large() -> None:
    # 4 px/s: nothing within 5 ms, but within 100 ms a turn that a calibration would believe.
    for skew, taken in ((0.005, True), (0.1, False)):
        collector, rig = ViewCollector(BOARD, SIZE), Rig()
        looks = [
            collector.look(
                *rig.see(FACING, np.add(MIDDLE, (0.0005 * k, 0, 0))), 0.1 * k, skew_s=skew
            )
            for k in range(8)
        ]
        assert any(look.view for look in looks) is taken


def test_guidance_names_the_camera_that_does_not_see_the_board() -> None:
    collector, rig = ViewCollector(BOARD, SIZE), Rig()
    left, right = rig.see(FACING, MIDDLE)
    assert collector.look(None, None, 0.0).words == (
        "Show the chessboard 9x6, 25 mm to both cameras"
    )
    look = collector.look(left, None, 0.1)
    assert look.words == "Show the board to both cameras: the right camera does not see it"
    assert look.seen == (True, False)
    assert "the left camera" in collector.look(None, right, 0.2).words
    assert look.still is None


def test_brief_detection_gap_does_not_reset_stillness() -> None:
    collector, rig = ViewCollector(BOARD, SIZE), Rig()
    for k in range(3):
        collector.look(*rig.see(FACING, MIDDLE), 0.1 * k)
    collector.look(None, None, 0.25)
    assert collector.look(*rig.see(FACING, MIDDLE), 0.35).view
    assert not collector.look(None, None, 5.0).view


def test_first_requested_pose_is_in_the_middle() -> None:
    look = ViewCollector(BOARD, SIZE).look(None, None, 0.0)
    assert look.ghost is not None
    assert look.next_words == "Hold the board in the middle of the image"
    # Not exactly in the middle: the right camera sees it further left.
    assert 200 < look.ghost[:, 0].mean() < 440
    assert look.ghost[:, 1].mean() == pytest.approx(239.5, abs=30)


def test_manual_capture_requires_both_cameras_to_see_the_board() -> None:
    collector, rig = ViewCollector(BOARD, SIZE), Rig()
    with pytest.raises(CalibrationError, match="not visible to both cameras right now"):
        collector.capture(0.0)
    collector.look(*rig.see(FACING, MIDDLE), 0.0)
    assert collector.capture(0.1).name == "1"
    assert collector.capture(0.2).name == "2"
    with pytest.raises(CalibrationError, match="show it to both"):
        collector.capture(3.0)
    left, _ = rig.see(FACING, MIDDLE)
    collector.look(left, None, 4.0)
    with pytest.raises(CalibrationError):
        collector.capture(4.0)


def test_undone_view_is_not_recaptured_until_the_board_moves() -> None:
    collector, rig = ViewCollector(BOARD, SIZE), Rig()
    hold(collector, rig, MIDDLE, 0.0)
    taken = collector.undo()
    assert taken is not None
    assert taken.name == "1"
    looks = hold(collector, rig, MIDDLE, 0.6)
    assert not any(look.view for look in looks)
    assert looks[-1].words == "View removed: move the board before the next one"
    assert max(looks[-1].coverage.bars.values()) == 0
    there = hold(collector, rig, np.add(MIDDLE, (0.12, 0.1, 0.1)), 2.0)
    assert any(look.view for look in there)
    assert ViewCollector(BOARD, SIZE).undo() is None


def test_views_are_removed_by_name_and_names_are_not_reused() -> None:
    collector, rig = ViewCollector(BOARD, SIZE), Rig()
    collector.look(*rig.see(FACING, MIDDLE), 0.0)
    for _ in range(3):
        collector.capture(0.1)
    collector.remove("2")
    assert collector.capture(0.1).name == "4"
    assert [view.name for view in collector.views] == ["1", "3", "4"]
    with pytest.raises(CalibrationError, match="no view '2'; there are 1, 3, 4"):
        collector.remove("2")


def test_collector_resumes_with_existing_views_after_a_crash() -> None:
    collector, rig = ViewCollector(BOARD, SIZE), Rig()
    hold(collector, rig, MIDDLE, 0.0)
    hold(collector, rig, np.add(MIDDLE, (0.15, 0.1, 0.2)), 2.0)
    again = ViewCollector(BOARD, SIZE, collector.views)
    assert again.views == collector.views
    assert again.coverage.bars == pytest.approx(collector.coverage.bars, abs=0.05)
    looks = hold(again, rig, MIDDLE, 0.0)
    assert not any(look.view for look in looks)
    assert looks[-1].words.startswith("Already captured")


def test_unreachable_pose_is_abandoned() -> None:
    collector, rig = ViewCollector(BOARD, SIZE), Rig()
    hold(collector, rig, MIDDLE, 0.0)
    first = collector.look(*rig.see(FACING, MIDDLE), 1.0).ghost
    assert first is not None
    waiting = collector.look(*rig.see(FACING, MIDDLE), 9.0).ghost
    assert waiting is not None
    np.testing.assert_array_equal(waiting, first)
    collector.look(*rig.see(FACING, MIDDLE), 15.0)
    other = collector.look(*rig.see(FACING, MIDDLE), 15.1).ghost
    assert other is not None
    assert np.abs(other - first).max() > 5


@pytest.mark.parametrize(
    ("board", "focal", "baseline"),
    [
        (Board(), 500.0, 0.08),
        (Board(), 700.0, 0.12),
        (Board("charuco"), 400.0, 0.06),
        (Board("chessboard", 7, 5, 0.03), 500.0, 0.12),
    ],
    ids=["usual", "tele", "charuco", "wide baseline"],
)
def test_following_the_outline_fills_all_bars(board: Board, focal: float, baseline: float) -> None:
    collector, rig = ViewCollector(board, SIZE), Rig(board, focal, baseline, seed=3)
    look = collector.look(None, None, 0.0)
    time = 0.0
    for _ in range(40):
        if look.ghost is None:
            break
        turn, place = rig.follow(look.ghost)
        for _ in range(7):
            time += 0.1
            look = collector.look(*rig.see(turn, place), time)
            if look.view:
                break
    assert look.ghost is None
    assert min(look.coverage.bars.values()) == 1
    assert look.coverage.enough
    assert len(collector.views) <= 25
    assert set(look.coverage.reached.values()) == {1.0}
    assert look.coverage.missing == ()
    # The outermost corners determine distortion: both images have some in all four corners.
    for side in ("left", "right"):
        px = np.concatenate([getattr(view, side).px for view in collector.views])
        out = (px - 319.5) / 320, (px - 239.5) / 240
        for su in (-1, 1):
            for sv in (-1, 1):
                x, y = su * out[0][:, 0], sv * out[1][:, 1]
                assert np.minimum(x, y).max() > 0.5, (side, su, sv)

import cv2
import numpy as np
import pytest

from observer.calibration.boards.board import Board, BoardSighting
from observer.calibration.boards.coverage import ViewMeasures
from observer.calibration.boards.guidance import Guide, SeenPose, WantedPose

from .drawn_boards import SIZE, camera_matrix

BOARD = Board()
GUIDE = Guide(BOARD, SIZE)
FACING = SeenPose(np.array([319.5, 239.5]), 2.0, np.array([0.0, 0.0, 1.0]))
NOTHING = ViewMeasures(np.zeros(4), np.zeros(4))


def wanted(centre: tuple[float, float], depth: float, normal: tuple[float, ...]) -> WantedPose:
    direction = np.array(normal) / np.linalg.norm(normal)
    pose = SeenPose(np.array(centre), depth, direction)
    return WantedPose(0, np.zeros((4, 2)), pose, NOTHING.beside(NOTHING))


@pytest.mark.parametrize(
    ("centre", "depth", "normal", "words"),
    [
        ((100, 80), 1.2, (0, 0, 1), "Move it to the upper left of the image and closer"),
        ((319.5, 400), 2.0, (0, 0, 1), "Move it to the bottom of the image"),
        ((319.5, 239.5), 3.0, (0, 0, 1), "Move it further away"),
        ((319.5, 239.5), 2.0, (-1, 0, 1), "Tilt its right side away from the cameras"),
        (
            (500, 239.5),
            2.0,
            (1, -1, 1.4),
            "Move it to the right of the image; tilt its lower left corner away from the cameras",
        ),
        ((330, 245), 2.1, (0.1, 0, 1), "Hold it there"),
    ],
)
def test_words_describe_what_differs(
    centre: tuple[float, float], depth: float, normal: tuple[float, ...], words: str
) -> None:
    assert GUIDE.words(wanted(centre, depth, normal), FACING) == words


def test_words_describe_the_whole_pose_when_no_board_is_seen() -> None:
    target = wanted((319.5, 60), 2.0, (0, 1, 1))
    assert GUIDE.words(target, None) == (
        "Hold the board in the top of the image, tilt its top side away from the cameras"
    )
    tilted = SeenPose(np.array([319.5, 239.5]), 2.0, np.array([0.0, 0.6, 0.8]))
    assert GUIDE.words(wanted((319.5, 239.5), 2.0, (0, 0, 1)), tilted) == (
        "Turn it to face the cameras"
    )


def test_side_described_as_away_is_farther() -> None:
    # A board whose right side is further from the camera than its left one.
    rotation = cv2.Rodrigues(np.array([0.0, -0.7, 0.0]))[0]
    points = BOARD.object_points @ rotation.T + (-0.08, -0.06, 0.6)
    assert points[8, 2] > points[0, 2]
    px = points @ camera_matrix(0.8 * SIZE[0]).T
    seen = GUIDE.seen(BoardSighting(np.arange(54, dtype=np.int32), px[:, :2] / px[:, 2:]))
    assert seen is not None
    assert seen.depth * 0.2 == pytest.approx(points.mean(axis=0)[2], rel=1e-3)
    assert GUIDE.words(wanted(tuple(seen.centre_px), seen.depth, tuple(seen.normal)), FACING)
    words = GUIDE.words(
        wanted(tuple(seen.centre_px), FACING.depth, tuple(seen.normal)),
        SeenPose(seen.centre_px, FACING.depth, FACING.normal),
    )
    assert words == "Tilt its right side away from the cameras"


def test_outline_has_the_perspective_of_its_pose() -> None:
    # Each requested pose in turn, as if taken exactly.
    kept: list[ViewMeasures] = []
    poses: list[SeenPose] = []
    checked = 0
    for _ in range(8):
        pose = GUIDE.next_pose(kept, poses)
        assert pose is not None
        assert (pose.outline >= 0).all()
        assert (pose.outline <= np.subtract(SIZE, 1)).all()
        sides = np.linalg.norm(pose.outline - np.roll(pose.outline, -1, axis=0), axis=1)
        # The side further away is the shorter one.
        right_is_away = -pose.pose.normal[0]
        if abs(right_is_away) > 0.5 and abs(pose.pose.normal[1]) < 0.1:
            assert (sides[1] < sides[3]) == (right_is_away > 0)
            checked += 1
        kept.append(pose.measures)
        poses.append(pose.pose)
    assert checked, "no pose distinguishes the sides"
    normals = np.array([pose.normal for pose in poses])
    apart = np.rad2deg(np.arccos(np.clip(normals @ normals.T, -1, 1)))
    assert (apart[0] > 20).sum() >= 4, "the board is hardly ever tilted"


def test_poses_outside_a_wide_baselines_view_are_not_requested() -> None:
    # At 3 board widths the right camera already sees the board a third of an image further left.
    near, far = GUIDE.wanted_ranges([(3.0, -40.0, 0.0)]), GUIDE.wanted_ranges([(3.0, -200.0, 0.0)])
    assert near == (0.7, 0.7, 0.4, 0.5)
    assert far[2] < 0.4

"""Collecting views of a board in front of two live cameras, with constant advice on what to do.

It has no thread and no clock: the caller passes the time, so that tests can simulate any person.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from observer.calibration.boards.board import FEWEST_CORNERS, Board, BoardSighting, BoardView
from observer.calibration.boards.coverage import (
    Coverage,
    ViewMeasures,
    coverage,
    is_new,
    measure_view,
)
from observer.calibration.boards.detection import same_numbering
from observer.calibration.boards.guidance import Guide, SeenPose, Shift, WantedPose
from observer.errors import CalibrationError
from observer.geometry import Float64Array

# Seconds: a hand rests for about this long before it moves on.
_STILL_S = 0.3
# Detection may miss the board for so many seconds without the board having moved.
_GAP_S = 0.25
# Pixels at an image width of 640: more motion in 0.3 s blurs the image.
_STILL_PX = 2.0
# Pixels at an image width of 640: how far the board may move between both cameras' exposures; a
# calibration would take this motion for a rotated camera.
_SKEW_PX = 0.1
# Seconds between both exposures, assumed for free-running cameras at 30 Hz: half a frame, the most.
_USUAL_SKEW_S = 1 / 60
# Seconds: a view captured by hand must have been seen this recently.
_FRESH_S = 0.5
# Seconds: a wanted pose not taken by then is unreachable or not understood; ask for another.
_PATIENCE_S = 12.0


@dataclass(frozen=True, eq=False)
class Look:
    """Result of one look at both images.

    Attributes:
        view: the view captured now, None if none was.
        words: one sentence on what to do or what happened.
        coverage: of all views, a captured one included.
        next_words: how to move the board to the next wanted pose; empty when none is wanted.
        ghost: (4, 2) pixels of the left image: where the squares' outer edge should be, or None.
        still: whether the board is at rest; None where it is not seen, or not yet for 0.3 s.
        seen: whether the left and the right camera see the board.
    """

    view: BoardView | None
    words: str
    coverage: Coverage
    next_words: str
    ghost: Float64Array | None
    still: bool | None
    seen: tuple[bool, bool]


@dataclass(frozen=True, eq=False)
class _Kept:
    view: BoardView
    measures: ViewMeasures | None
    pose: SeenPose | None


@dataclass(frozen=True, eq=False)
class _Moment:
    time: float
    left: BoardSighting
    right: BoardSighting


class ViewCollector:
    """Collector that takes a view whenever the board rests in a pose new to both cameras.

    Args:
        image_size: width and height of each camera's image, pixels.
        views: taken before, for example before a crash.

    Attributes:
        automatic: whether a new pose held still is captured automatically.
    """

    def __init__(
        self, board: Board, image_size: tuple[int, int], views: Iterable[BoardView] = ()
    ) -> None:
        self._board = board
        self._image_size = image_size
        self.automatic = True
        self._guide = Guide(board, image_size)
        self._shifts: deque[Shift] = deque(maxlen=50)
        self._kept = [self._keep(view) for view in views]
        self._recent: deque[_Moment] = deque()
        # The pose whose view was removed, so that it is not captured again at once.
        self._taken_back: ViewMeasures | None = None
        self._skipped: set[int] = set()
        self._wanted: WantedPose | None = None
        self._wanted_since: float | None = None
        self._plan_is_due = True
        self._ranges = self._guide.wanted_ranges(tuple(self._shifts))

    @property
    def views(self) -> tuple[BoardView, ...]:
        """Views that were captured and not removed, oldest first."""
        return tuple(kept.view for kept in self._kept)

    @property
    def coverage(self) -> Coverage:
        return coverage(self._measures(), self._ranges)

    def look(
        self,
        left: BoardSighting | None,
        right: BoardSighting | None,
        time: float,
        *,
        skew_s: float | None = None,
    ) -> Look:
        """Judge what both cameras see, and capture it if it is worthwhile.

        Args:
            time: seconds on any clock that never goes back.
            skew_s: time between the exposures of both images, if it is known.
        """
        if left is not None and right is not None:
            right = same_numbering(left, right, self._board)
        now = _Moment(time, left, right) if left is not None and right is not None else None
        measures = self._measure(left, right)
        still = self._rest(now, time, _USUAL_SKEW_S if skew_s is None else skew_s)
        pose = self._guide.seen(left) if left is not None else None
        if now is not None and pose is not None and still and not self._kept:
            self._learn_shift(pose, now.left, now.right)
        if self._taken_back is not None and (
            still is False or (measures and is_new(measures, [self._taken_back]))
        ):
            self._taken_back = None
        view = None
        may_take = self.automatic and still and self._taken_back is None
        new = measures is not None and is_new(measures, self._measures())
        if now is not None and may_take and new:
            view = self._capture(now)
        self._follow(time, left is not None or right is not None)
        covered = self.coverage
        next_words = self._guide.words(self._wanted, pose) if self._wanted else ""
        if not next_words and not covered.enough:
            next_words = "Move the board to a new position"
        if view is not None:
            words = f"Captured {view.name}" + ("; enough views" if covered.enough else "")
        elif measures is None:
            words = self._unseen(left, right)
        elif not still:
            words = "Hold the board still"
        elif self._taken_back is not None:
            words = "View removed: move the board before the next one"
        elif covered.enough:
            words = "Enough views: compute the calibration, or keep going for " + (
                ", ".join(covered.missing[:2]) if covered.missing else "good measure"
            )
        else:
            words = f"Already captured: {next_words[0].lower()}{next_words[1:]}"
        ghost = self._wanted.outline if self._wanted else None
        seen = left is not None, right is not None
        return Look(view, words, covered, next_words, ghost, still, seen)

    def capture(self, time: float) -> BoardView:
        """Capture what was seen last, new or not, still or not.

        Raises:
            CalibrationError: the board is not in both views at this time.
        """
        last = self._recent[-1] if self._recent else None
        if (
            last is None
            or time - last.time > _FRESH_S
            or self._measure(last.left, last.right) is None
        ):
            raise CalibrationError(
                "the board is not visible to both cameras right now; show it to both and capture "
                "again"
            )
        return self._capture(last)

    def undo(self) -> BoardView | None:
        """Remove and return the newest view; None if there is none."""
        return self._take_back(len(self._kept) - 1) if self._kept else None

    def remove(self, name: str) -> BoardView:
        """Remove and return the view of this name.

        Raises:
            CalibrationError: there is no view of this name.
        """
        names = [kept.view.name for kept in self._kept]
        if name not in names:
            raise CalibrationError(
                f"there is no view {name!r}; there are {', '.join(names) or 'none yet'}"
            )
        return self._take_back(names.index(name))

    def _measures(self) -> list[ViewMeasures]:
        return [kept.measures for kept in self._kept if kept.measures is not None]

    def _measure(
        self, left: BoardSighting | None, right: BoardSighting | None
    ) -> ViewMeasures | None:
        if left is None or right is None or len(left.common_px(right)[0]) < FEWEST_CORNERS:
            return None
        a, b = (measure_view(each, self._board, self._image_size) for each in (left, right))
        return None if a is None or b is None else a.beside(b)

    def _keep(self, view: BoardView) -> _Kept:
        left, right = view.left, view.right
        pose = self._guide.seen(left) if left is not None else None
        if pose is not None and left is not None and right is not None:
            self._learn_shift(pose, left, right)
        return _Kept(view, self._measure(left, right), pose)

    def _capture(self, now: _Moment) -> BoardView:
        used = [int(k.view.name) for k in self._kept if k.view.name.isdecimal()]
        kept = self._keep(BoardView(str(max(used, default=0) + 1), now.left, now.right))
        self._kept.append(kept)
        self._plan_is_due = True
        return kept.view

    def _take_back(self, index: int) -> BoardView:
        kept = self._kept.pop(index)
        self._taken_back = kept.measures
        self._plan_is_due = True
        return kept.view

    def _learn_shift(self, pose: SeenPose, left: BoardSighting, right: BoardSighting) -> None:
        in_left, in_right = left.common_px(right)
        if len(in_left):
            du, dv = (in_right - in_left).mean(axis=0).tolist()
            self._shifts.append((pose.depth, du, dv))

    def _rest(self, now: _Moment | None, time: float, skew_s: float) -> bool | None:
        """Return whether the board rests in both images; None if unseen or not for long enough."""
        recent = self._recent
        if recent and time - recent[-1].time > _GAP_S:
            recent.clear()
        if now is None:
            return None
        recent.append(now)
        # Keep one moment from before the span, so that the span is covered completely.
        while len(recent) > 2 and time - recent[1].time >= _STILL_S:
            recent.popleft()
        since = time - recent[0].time
        scale = self._image_size[0] / 640
        moved = [_moved(then, now) for then in recent]
        limit = _STILL_PX * scale
        if since > 0:
            limit = min(limit, max(0.5, _SKEW_PX * scale * since / max(skew_s, 1e-6)))
        if max(moved) > limit:
            return False
        return True if since >= _STILL_S else None

    def _follow(self, time: float, seen: bool) -> None:
        """Keep the wanted pose until a view is captured or the pose is given up."""
        if self._wanted_since is None:
            # The time starts when the board is first seen.
            self._wanted_since = time if seen else None
        elif time - self._wanted_since > _PATIENCE_S and self._wanted is not None:
            self._skipped.add(self._wanted.number)
            self._plan_is_due = True
        if self._plan_is_due:
            self._plan()
            self._wanted_since = time if seen else None

    def _plan(self) -> None:
        poses = [kept.pose for kept in self._kept if kept.pose is not None]
        shifts = tuple(self._shifts)
        self._ranges = self._guide.wanted_ranges(shifts)
        measures = self._measures()
        self._wanted = self._guide.next_pose(measures, poses, shifts, self._skipped)
        if self._wanted is None and self._skipped:
            self._skipped.clear()
            self._wanted = self._guide.next_pose(measures, poses, shifts)
        self._plan_is_due = False

    def _unseen(self, left: BoardSighting | None, right: BoardSighting | None) -> str:
        if left is None and right is None:
            return f"Show the {self._board.words} to both cameras"
        if left is None or right is None:
            which = "left" if left is None else "right"
            return f"Show the board to both cameras: the {which} camera does not see it"
        return "Show more of the board: both cameras must see the same part"


def _moved(then: _Moment, now: _Moment) -> float:
    """Mean motion of the corners, pixels, in the camera where it is larger."""
    largest = 0.0
    for a, b in ((then.left, now.left), (then.right, now.right)):
        before, after = a.common_px(b)
        if len(before) < FEWEST_CORNERS // 2:
            return np.inf
        largest = max(largest, float(np.linalg.norm(before - after, axis=1).mean()))
    return largest

"""Watch of the vertical offset between left and right over minutes and hours.

``observer.vision.image_health`` reports at once when rows are too far apart to be used; this
reports the offset and its growth long before, while the frames are still as good as ever.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array
from observer.number_format import format_number
from observer.robust import MAD_TO_SIGMA
from observer.vision.epipolar_error import EpipolarError, epipolar_error

# The warning starts when rows are further apart than the first and ends below the second.
WARN_PX = 0.5
_END_PX = 0.4
# Seconds between two looks: one takes 0.3 ms, and rows drift slowly.
_LOOK_S = 0.8
# The current value is the median of this many looks, 10 s, of which a blurred one spoils two. It
# needs the following number of looks over as many seconds; looks older than the last do not count.
_RECENT = 12
_ENOUGH, _ENOUGH_S = 6, 4.5
_RECENT_S = 60.0
_SURE_SIGMAS = 2.0
# Row error caused by the scene itself through occlusion and interpolation, pixels.
_SCENE_PX = 0.02
# The history: medians over half a minute, merged in pairs when there are too many.
_BLOCK_S = 30.0
_MOST_BLOCKS = 120
# The trend is fitted to the newest blocks; a total change below this, or a trend below so many
# standard deviations, is none.
_TREND_BLOCKS, _LEAST_TREND_BLOCKS = 20, 4
_LEAST_CHANGE_PX = 0.1
_TREND_SIGMAS = 3.0
# Pitch or roll is named alone where it makes up this share of the squared error.
_MAINLY = 0.8


@dataclass(frozen=True)
class RowDrift:
    """Vertical offset between the rows of left and right, now and over time.

    The error is that of pitch and roll: its root mean square over the image, pixels. All times are
    seconds for which frames were watched; restarting the source does not reset them.

    Attributes:
        now_px: over the last 10 s; None while it is not known, as are the next two.
        median_px: v_left - v_right in the middle of the image, signed: what pitch does.
        roll_rad: by how much the right image is turned against the left one, clockwise positive.
        since_s: when the rows were found too far apart; None without a warning.
        trend_px_per_min: by how much ``now_px`` grows; None where nothing is significant.
        warning: one sentence; None while the rows are near enough.
        history: (time_s, px), the middle of each stretch of time and its error, oldest first.
    """

    now_px: float | None = None
    median_px: float | None = None
    roll_rad: float | None = None
    since_s: float | None = None
    trend_px_per_min: float | None = None
    warning: str | None = None
    history: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class _Rows:
    """Vertical error by pitch, pixels, and by roll: its signed root mean square over the image.

    Attributes:
        time_s: when. std_px: one standard deviation of both together.
    """

    time_s: float
    pitch_px: float
    roll_px: float
    std_px: float

    @property
    def typical_px(self) -> float:
        return math.hypot(self.pitch_px, self.roll_px)


class RowDriftWatch:
    """Watch of one calibration's rows, fed with every frame; costs 0.02 ms a frame on average.

    The stretch of the rows along v is left out: no rotation of a camera causes it, but exposure
    skew does whenever the robot drives ahead.
    """

    def __init__(self, camera: StereoCamera) -> None:
        self._camera = camera
        # Factor from a roll angle to the root mean square of its row offsets over the image.
        self._px_per_roll = camera.width / 2 / math.sqrt(3)
        self._clock_s = 0.0
        self._time_s: float | None = None
        self._looked_s = -math.inf
        self._recent: deque[_Rows] = deque(maxlen=_RECENT)
        self._open: list[_Rows] = []
        self._blocks: list[_Rows] = []
        self._block_s = _BLOCK_S
        self._since_s: float | None = None
        self._found = RowDrift()

    def add_frame(
        self, time_s: float, px: Float64Array | None, offset_px: Float64Array | None
    ) -> RowDrift:
        """Return what is known after one more frame.

        Args:
            time_s: the frame's, seconds on the source's clock.
            px: (N, 2) pixels, rectified left image. offset_px: (N,) left minus right row, pixels,
                NaN unknown; both None where the frame shows no matches.
        """
        if self._time_s is not None:
            self._clock_s += max(0.0, time_s - self._time_s)
        self._time_s = time_s
        if self._clock_s - self._looked_s < _LOOK_S:
            return self._found
        self._looked_s = self._clock_s
        if px is not None and offset_px is not None:
            error = epipolar_error(px, offset_px, self._camera)
            if error is not None:
                self._keep(error)
        self._found = self._tell()
        return self._found

    def _keep(self, error: EpipolarError) -> None:
        roll_px = error.roll_rad * self._px_per_roll
        rows = _Rows(self._clock_s, error.centre_px, roll_px, error.typical_std_px)
        self._recent.append(rows)
        self._open.append(rows)
        if rows.time_s - self._open[0].time_s < self._block_s or len(self._open) < _ENOUGH:
            return
        self._blocks.append(_median(self._open))
        self._open = []
        if len(self._blocks) == _MOST_BLOCKS:
            two = zip(self._blocks[::2], self._blocks[1::2], strict=True)
            self._blocks = [_median(list(pair)) for pair in two]
            self._block_s *= 2

    def _tell(self) -> RowDrift:
        history = tuple((block.time_s, block.typical_px) for block in self._blocks)
        while self._recent and self._clock_s - self._recent[0].time_s > _RECENT_S:
            self._recent.popleft()
        recent = list(self._recent)
        if len(recent) < _ENOUGH or recent[-1].time_s - recent[0].time_s < _ENOUGH_S:
            return RowDrift(history=history)
        now = _median(recent)
        if now.typical_px < _END_PX:
            self._since_s = None
        elif self._since_s is None and now.typical_px - _SURE_SIGMAS * now.std_px > WARN_PX:
            self._since_s = self._clock_s
        blocks = self._blocks[-_TREND_BLOCKS:]
        trend = _trend_px_per_s(blocks, now)
        return RowDrift(
            now_px=now.typical_px,
            median_px=now.pitch_px,
            roll_rad=now.roll_px / self._px_per_roll,
            since_s=self._since_s,
            trend_px_per_min=None if trend is None else 60 * trend,
            warning=None if self._since_s is None else self._warning(now, blocks, trend),
            history=history,
        )

    def _warning(self, now: _Rows, blocks: list[_Rows], trend: float | None) -> str:
        sentence = f"the epipolar error is {now.typical_px:.1f} px"
        if trend is not None:
            course = "growing" if trend > 0 else "shrinking"
            ago = _duration(self._clock_s - blocks[0].time_s)
            rate = _rate(abs(trend))
            sentence += f", {blocks[0].typical_px:.1f} px {ago} ago and {course} by {rate}"
        # Name the angle, pitch or roll, that causes the offset.
        pitch_deg = math.degrees(now.pitch_px / self._camera.fy)
        roll_deg = math.degrees(now.roll_px / self._px_per_roll)
        pitch = f"pitch ({format_number(pitch_deg, 2, signed=True)} deg)"
        roll = f"roll ({format_number(roll_deg, 2, signed=True)} deg)"
        pitch_share = (now.pitch_px / now.typical_px) ** 2
        if pitch_share > _MAINLY:
            by = pitch
        elif pitch_share < 1 - _MAINLY:
            by = roll
        else:
            by = f"{pitch} and {roll}"
        return (
            f"{sentence}, caused by {by} between the cameras; the limit is {WARN_PX:g} px: "
            "refine the calibration from the scene"
        )


def _median(rows: list[_Rows]) -> _Rows:
    """Return the median of several looks, and how well it is known.

    A standing camera sees the same points with the same errors in every look, so more looks do
    not reduce the standard deviation of one; where they scatter more, the scatter counts.
    """
    values = np.array([(r.time_s, r.pitch_px, r.roll_px, r.std_px) for r in rows])
    time_s, pitch, roll, std = np.median(values, axis=0).tolist()
    apart = np.hypot(values[:, 1] - pitch, values[:, 2] - roll)
    scatter = MAD_TO_SIGMA * float(np.median(apart)) / math.sqrt(len(rows))
    return _Rows(time_s, pitch, roll, math.hypot(max(std, scatter), _SCENE_PX))


def _trend_px_per_s(blocks: list[_Rows], now: _Rows) -> float | None:
    """Return the growth rate of the current error, by straight lines through pitch and roll."""
    if len(blocks) < _LEAST_TREND_BLOCKS or now.typical_px == 0:
        return None
    time = np.array([block.time_s for block in blocks])
    values = np.array([(block.pitch_px, block.roll_px) for block in blocks])
    time = time - time.mean()
    spread = float(time @ time)
    slope = time @ values / spread
    rest = values - values.mean(axis=0) - time[:, None] * slope
    # The larger of the scatter of the blocks and the error that the scene may cause in each.
    sigma = max(float(np.sqrt(np.mean(rest**2) * len(blocks) / (len(blocks) - 2))), _SCENE_PX)
    direction = np.array([now.pitch_px, now.roll_px]) / now.typical_px
    trend = float(slope @ direction)
    change = abs(trend) * float(time[-1] - time[0])
    if change < _LEAST_CHANGE_PX or abs(trend) < _TREND_SIGMAS * sigma / math.sqrt(spread):
        return None
    return trend


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} minutes" if seconds < 7200 else f"{seconds / 3600:.1f} hours"


def _rate(px_per_s: float) -> str:
    per_minute = 60 * px_per_s
    if per_minute >= 0.01:
        return f"{per_minute:.2f} px per minute"
    return f"{60 * per_minute:.2f} px per hour"

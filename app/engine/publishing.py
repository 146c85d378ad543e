"""Publisher of the watched views, each into its slot."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from app.contract.events import DenseStereoEvent
from app.contract.views import CAMERA_NAMES, CLOUD_NAME, DISPARITY_NAME, VIEW_NAMES, ViewHeader
from app.engine.dense_stereo import DensePair, DenseStereo, PairKeeper, cloud_value, dense_stereo
from app.engine.latest_worker import LatestWorker
from app.engine.views import draw_disparity, draw_view, encode_jpeg, jpeg_size
from app.engine.watched import Observed
from app.runtime.latest import LatestWriter
from observer.errors import InputError
from observer.types import Image

# The scene is drawn ten times a second; a little more, so that a busy machine keeps up the ten.
DENSE_RATE_HZ = 12.0
_DENSE = frozenset({CLOUD_NAME, DISPARITY_NAME})


@dataclass(frozen=True, eq=False)
class _DenseJob:
    pair: DensePair
    # Epoch of the source: a job from a source closed meanwhile is not shown.
    epoch: int


class Publisher:
    """Publisher that draws, encodes and writes views and the cloud while somebody watches them.

    A thread beside the loop computes everything that needs dense stereo, from the newest pair and
    at its own rate; the rest is drawn at once. Only one thread writes each slot.
    """

    def __init__(
        self,
        slots: Mapping[str, LatestWriter],
        clock: Callable[[], float],
        send: Callable[[DenseStereoEvent], None],
    ) -> None:
        """Set the slots.

        Args:
            slots: one for each name in ``VIEW_NAMES`` and ``CLOUD_NAME``.
            clock: the host's monotonic clock.
            send: told of every cloud or disparity view, including failed ones; called in the other
                thread.
        """
        self._slots = slots
        self._clock = clock
        self._send = send
        self._watched: frozenset[str] = frozenset()
        self._newest: Observed | None = None
        self._pairs = PairKeeper()
        self._epoch = 0
        self._writing = threading.Lock()
        self._dense = LatestWorker("dense stereo", self._make_dense, rate_hz=DENSE_RATE_HZ)

    def watch(self, names: Iterable[str]) -> None:
        """Draw these views from now on; show newly watched ones at once, even while paused.

        Raises:
            InputError: there is no such view; the sentence lists those that exist.
        """
        wanted = frozenset(names)
        unknown = wanted - {*VIEW_NAMES, CLOUD_NAME}
        if unknown:
            raise InputError(
                f"there is no view {', '.join(sorted(unknown))}; "
                f"there are: {', '.join((*VIEW_NAMES, CLOUD_NAME))}"
            )
        new, self._watched = wanted - self._watched, wanted
        if self._newest is not None:
            self._draw(self._newest, new)

    @property
    def newest(self) -> Observed | None:
        """Return the newest observed frame of the open source."""
        return self._newest

    def publish(self, observed: Observed) -> None:
        """Draw the watched views of the newest frame."""
        self._newest = observed
        self._pairs.remember(observed)
        self._draw(observed, self._watched)

    def show_cameras(self, facts: dict[str, Any], draw: Callable[[str], Image]) -> None:
        """Show the cameras' images as drawn by the caller.

        Args:
            facts: frame, time and received of the pair.
            draw: makes the image of a name.
        """
        for name in sorted(self._watched.intersection(CAMERA_NAMES)):
            image = draw(name)
            width, height = jpeg_size(*image.shape[1::-1])
            header = {**facts, "width": width, "height": height}
            self._slots[name].write(header, encode_jpeg(image))

    def forget(self) -> None:
        """Drop the closed source's frame, so that it is not shown again."""
        self._newest = None
        self._pairs = PairKeeper()
        self._dense.forget()
        with self._writing:
            self._epoch += 1

    def close(self) -> None:
        """End the thread; nothing is written any more."""
        self.forget()
        self._dense.close()

    def _draw(self, observed: Observed, names: frozenset[str]) -> None:
        if names & _DENSE:
            self._dense.give(_DenseJob(self._pairs.pair(observed), self._epoch))
        frame = observed.frame
        facts = {"frame": frame.index, "time": frame.time, "received": frame.received}
        if names.intersection(CAMERA_NAMES):
            images = dict(zip(CAMERA_NAMES, (frame.left, frame.right), strict=True))
            self.show_cameras(facts, images.__getitem__)
        for name in names - _DENSE - set(CAMERA_NAMES):
            width, height = jpeg_size(*frame.left.shape[1::-1])
            header = {**facts, "width": width, "height": height}
            self._slots[name].write(header, draw_view(name, observed))

    # --- in the other thread ---------------------------------------------------------------

    def _make_dense(self, job: _DenseJob) -> None:
        begin, watched = self._clock(), self._watched & _DENSE
        if not watched:
            return
        dense = trouble = None
        try:
            dense = dense_stereo(job.pair)
            self._write_dense(job, dense, watched)
        except Exception as error:  # noqa: BLE001
            # A failure in display must stop neither the observing nor the next attempt.
            trouble = f"dense stereo failed: {type(error).__name__}: {error}"
        now, instant = self._clock(), job.pair.instant
        self._send(
            DenseStereoEvent(
                frame=instant["frame"],
                received=instant["received"],
                published=now,
                seconds=now - begin,
                coarseness=None if dense is None else dense.coarseness,
                trouble=trouble,
            )
        )

    def _write_dense(
        self, job: _DenseJob, dense: DenseStereo | None, watched: frozenset[str]
    ) -> None:
        pair, instant = job.pair, job.pair.instant
        values: list[tuple[str, Mapping[str, Any], list[bytes]]] = []
        if CLOUD_NAME in watched and dense is not None:
            values.append((CLOUD_NAME, *cloud_value(pair, dense)))
        if DISPARITY_NAME in watched:
            width, height = jpeg_size(*pair.left.shape[1::-1])
            header: ViewHeader = {
                "frame": instant["frame"],
                "time": instant["time"],
                "received": instant["received"],
                "width": width,
                "height": height,
            }
            values.append((DISPARITY_NAME, header, [draw_disparity(pair, dense)]))
        with self._writing:
            if job.epoch == self._epoch:
                for name, facts, payload in values:
                    self._slots[name].write(facts, *payload)

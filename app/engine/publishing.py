"""Publisher of the watched views, each into its slot."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager

from app.contract.events import DenseStereoEvent
from app.contract.views import (
    CAMERA_NAMES,
    CLOUD_NAME,
    DISPARITY_NAME,
    VIEW_NAMES,
    CloudHeader,
    ViewHeader,
)
from app.engine.dense_stereo import (
    Cloud,
    DensePair,
    DenseStereo,
    PairKeeper,
    cloud_of,
    cloud_value,
    dense_stereo,
)
from app.engine.errors import unexpected
from app.engine.latest_worker import LatestWorker
from app.engine.observed import Observed
from app.engine.tolerated import Tolerated
from app.engine.views import draw_disparity, draw_view, encode_jpeg, jpeg_size
from app.runtime.latest import LatestWriter
from observer.errors import InputError
from observer.types import Image, StereoFrame

# The scene is drawn ten times a second; the margin lets a busy machine still reach ten.
DENSE_RATE_HZ = 12.0
# Share of one core: display must not slow down observing.
_DENSE_SHARE = 0.2
_DENSE = frozenset({CLOUD_NAME, DISPARITY_NAME})
# Interval at which a recording keeps a cloud, watched or not: 20000 points take 300 KB.
CLOUD_KEPT_EVERY_S = 1.0

# Stores a cloud with a run; also takes the reception time of its frame.
CloudKeeper = Callable[[Cloud, float], None]
# Pair, the epoch of its source (pairs of a source closed since are not shown), and keeper.
_DenseJob = tuple[DensePair, int, CloudKeeper | None]


class Publisher:
    """Publisher that draws, encodes and writes views and the cloud while somebody watches them.

    A thread beside the loop computes everything that needs dense stereo, from the newest pair and
    at its own rate; the rest is drawn at once. Only one thread writes each slot.

    Attributes:
        newest: the newest observed frame of the open source.
    """

    def __init__(
        self, slots: Mapping[str, LatestWriter], send: Callable[[DenseStereoEvent], None]
    ) -> None:
        """Set the slots.

        Args:
            slots: one for each name in ``VIEW_NAMES`` and ``CLOUD_NAME``.
            send: takes an event for every cloud or disparity view, including failed ones; called in
                the other thread.
        """
        self._slots = slots
        self._send = send
        self._watched: frozenset[str] = frozenset()
        self._tolerated = Tolerated()
        self.newest: Observed | None = None
        self._pairs = PairKeeper()
        self._epoch = 0
        self._keep_from = -math.inf
        self._writing = threading.Lock()
        self._dense = LatestWorker(
            "dense stereo", self._make_dense, rate_hz=DENSE_RATE_HZ, most_share=_DENSE_SHARE
        )

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
        self._tolerated.forget()
        if self.newest is not None:
            self._draw(self.newest, new)

    @property
    def troubles(self) -> tuple[str, ...]:
        """Return why views are missing, one sentence each, apart from those of dense stereo."""
        return self._tolerated.troubles

    def publish(self, observed: Observed, keep: CloudKeeper | None = None) -> None:
        """Draw the watched views of the newest frame; a view that fails is only reported.

        Args:
            keep: takes a cloud now and then, called in the other thread.
        """
        self.newest = observed
        with self._tolerated.work("keeping a pair for dense stereo"):
            self._pairs.remember(observed)
        self._draw(observed, self._watched, keep)

    def show_cameras(self, frame: StereoFrame, draw: Callable[[str], Image]) -> None:
        """Show the cameras' images of a frame as drawn by the caller.

        Args:
            draw: makes the image of a name.
        """
        for name in sorted(self._watched.intersection(CAMERA_NAMES)):
            with self._drawing(name):
                image = draw(name)
                header = _header(frame.index, frame.time, frame.received, image)
                self._slots[name].write(header, encode_jpeg(image))

    def forget(self) -> None:
        """Drop the frame of a closed source, so that it is not shown again."""
        self.newest = None
        self._tolerated.forget()
        self._pairs = PairKeeper()
        self._dense.forget()
        with self._writing:
            self._epoch += 1

    def close(self) -> None:
        """End the thread; nothing is written any more."""
        self.forget()
        self._dense.close()

    def _draw(
        self, observed: Observed, names: frozenset[str], keep: CloudKeeper | None = None
    ) -> None:
        if names & _DENSE or (keep is not None and observed.frame.received >= self._keep_from):
            with self._tolerated.work("choosing a pair for dense stereo"):
                self._dense.give((self._pairs.pair(observed), self._epoch, keep))
        frame = observed.frame
        if names.intersection(CAMERA_NAMES):
            images = dict(zip(CAMERA_NAMES, (frame.left, frame.right), strict=True))
            self.show_cameras(frame, images.__getitem__)
        for name in names - _DENSE - set(CAMERA_NAMES):
            with self._drawing(name):
                header = _header(frame.index, frame.time, frame.received, frame.left)
                self._slots[name].write(header, draw_view(name, observed))

    def _drawing(self, name: str) -> AbstractContextManager[None]:
        return self._tolerated.work(f"drawing the view {name}")

    # --- in the other thread ---------------------------------------------------------------

    def _make_dense(self, job: _DenseJob) -> None:
        begin, watched = time.monotonic(), self._watched & _DENSE
        (pair, epoch, keep), dense, trouble = job, None, None
        received = pair.instant["received"]
        # Decide this here, not when the job is queued: a newer job may replace one that was due.
        if keep is not None and received >= self._keep_from:
            self._keep_from = received + CLOUD_KEPT_EVERY_S
        else:
            keep = None
        if not watched and keep is None:
            return
        try:
            dense = dense_stereo(pair)
            self._write_dense(pair, dense, epoch, watched, keep)
        except Exception as error:  # noqa: BLE001
            # A display failure must stop neither observing nor the next attempt.
            trouble = f"dense stereo failed: {unexpected(error)}"
        if not watched and trouble is None:
            return
        now, instant = time.monotonic(), pair.instant
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
        self,
        pair: DensePair,
        dense: DenseStereo | None,
        epoch: int,
        watched: frozenset[str],
        keep: CloudKeeper | None,
    ) -> None:
        values: list[tuple[str, ViewHeader | CloudHeader, list[bytes]]] = []
        if dense is not None and (CLOUD_NAME in watched or keep is not None):
            cloud = cloud_of(pair, dense)
            if CLOUD_NAME in watched:
                values.append((CLOUD_NAME, *cloud_value(pair, dense, cloud)))
            if keep is not None:
                keep(cloud, pair.instant["received"])
        if DISPARITY_NAME in watched:
            instant = pair.instant
            header = _header(instant["frame"], instant["time"], instant["received"], pair.left)
            values.append((DISPARITY_NAME, header, [draw_disparity(pair, dense)]))
        with self._writing:
            if epoch == self._epoch:
                for name, facts, payload in values:
                    self._slots[name].write(facts, *payload)


def _header(frame: int, time: float, received: float, image: Image) -> ViewHeader:
    """Return the header of a view: its instant, and the size of the image's JPEG."""
    width, height = jpeg_size(*image.shape[1::-1])
    return {"frame": frame, "time": time, "received": received, "width": width, "height": height}

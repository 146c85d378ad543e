"""Live motion capture chosen by the user; the choice survives a restart of the server."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import replace
from typing import Any

from app.contract.commands import LiveTruthOrder, SetTruth
from app.contract.live_truth import LiveTruthStatus
from app.contract.values import of_plain, plain
from app.server.asking import ask
from app.server.errors import FieldError, NotAvailable
from app.server.shared import Shared
from observer.errors import TruthError
from observer.truth.live.opening import check_live

_KEY = "live_truth"
_LONGEST_SPEC = 300


class LiveTruthManager:
    """Manager of live motion capture; used in the event loop.

    Attributes:
        order: the motion capture in use, or None.
    """

    def __init__(self, shared: Shared, spec: str | None) -> None:
        """Start without motion capture; ``load`` restores the choice.

        Args:
            spec: motion capture that replaces the stored choice; None keeps that.
        """
        self.order: LiveTruthOrder | None = None
        self._shared = shared
        self._storage = shared.storage
        self._spec = spec

    def load(self) -> str | None:
        """Load the earlier choice; return a warning if it could not be used.

        Runs in a worker thread, before any other call.
        """
        stored = self._storage.get_setting(_KEY)
        kept = _order(stored)
        if self._spec is not None and (kept is None or kept.spec != self._spec):
            # Discard the chosen bodies: their names belong to another system.
            kept = LiveTruthOrder(self._spec)
            self._storage.set_setting(_KEY, plain(kept))
        self.order = kept
        if kept is None and stored is not None:
            return "the saved live motion capture cannot be used; choose it again"
        return None

    async def choose(self, order: LiveTruthOrder | None) -> LiveTruthStatus | None:
        """Listen to this motion capture from now on and store the choice; the source stays open.

        Returns:
            The status as in ``StateEvent.truth``; also None if there is no engine yet.

        Raises:
            FieldError: the order names no live motion capture; nothing is changed.
            StorageError: the choice could not be stored; nothing is changed.
        """
        async with self._shared.lock:
            if order is not None:
                order = checked(order)
            await asyncio.to_thread(self._storage.set_setting, _KEY, plain(order))
            self.order = order
            facts: LiveTruthStatus | None = None
            with contextlib.suppress(NotAvailable):
                # A restarting engine receives the order together with its source.
                facts = await ask(self._shared.engine, SetTruth(order), field=("body", "spec"))
            self._shared.followers.status_changed()
            return facts


def checked(order: LiveTruthOrder) -> LiveTruthOrder:
    """Return the order if it can be carried out.

    Raises:
        FieldError: the order names no live motion capture, or ignores the observer.
    """
    spec = order.spec.strip()
    if not spec.isprintable() or len(spec) > _LONGEST_SPEC:
        raise FieldError(("body", "spec"), "give vrpn:HOST, vrpn:HOST:PORT/NAME or vicon-udp:PORT")
    try:
        check_live(spec)
    except TruthError as error:
        raise FieldError(("body", "spec"), str(error)) from error
    if order.observer is not None and order.observer in order.ignore:
        raise FieldError(
            ("body", "ignore"),
            f"{order.observer} carries the camera and cannot be ignored as well; choose one",
        )
    return replace(order, spec=spec)


def _order(kept: Any) -> LiveTruthOrder | None:
    """Parse a stored order; return None if this version cannot use it."""
    with contextlib.suppress(ValueError, FieldError):
        return checked(of_plain(LiveTruthOrder, kept))
    return None

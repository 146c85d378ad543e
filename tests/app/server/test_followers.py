"""Followers of the server do not affect each other."""

from __future__ import annotations

from typing import Any

from app.server.followers import Followers


class Follower:
    """Keeps what it is told, and then fails if it is a failing one."""

    def __init__(self, *, fails: bool) -> None:
        self._fails = fails
        self.heard: list[Any] = []

    def _hear(self, what: Any) -> None:
        self.heard.append(what)
        if self._fails:
            raise ValueError("on purpose")

    def observed(self, event: Any) -> None:
        self._hear(event)

    def status_changed(self) -> None:
        self._hear("status")

    def robots_changed(self) -> None:
        self._hear("robots")


def test_a_failing_follower_does_not_affect_others() -> None:
    followers = Followers()
    one, other = Follower(fails=True), Follower(fails=False)
    leave = followers.follow(one)
    followers.follow(other)
    event: Any = object()
    followers.observed(event)
    followers.status_changed()
    followers.robots_changed()
    assert one.heard == other.heard == [event, "status", "robots"]
    leave()
    followers.status_changed()
    assert len(one.heard) == 3
    assert len(other.heard) == 4

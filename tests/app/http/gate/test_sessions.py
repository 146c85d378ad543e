"""The session table: who is signed in, for how long, and with how many connections."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from app.http.gate.connections import run_connected

from ..clock import Clock
from .session_tables import LIFETIME_S, TOKEN, UNUSED_S, found, table


class AgainstAModel(RuleBasedStateMachine):
    """After any sequence of events, exactly those are signed in who should be."""

    def __init__(self) -> None:
        super().__init__()
        self.clock = Clock()
        self.sessions = table(self.clock)
        # Id -> when it signed in, when it was last used, open connections, the session.
        self.known: dict[str, list[Any]] = {}
        self.gone: set[str] = set()

    def _is_over(self, session_id: str) -> bool:
        started, used, connections, _ = self.known[session_id]
        unused_s = 0.0 if connections else self.clock.now - used
        return self.clock.now - started > LIFETIME_S or unused_s > UNUSED_S

    def _use(self, session_id: str) -> Any:
        session = self.sessions.find(session_id)
        assert (session is None) == self._is_over(session_id)
        if session is None:
            self._forget(session_id)
            return None
        self.known[session_id][1] = self.clock.now
        return session

    def _forget(self, session_id: str) -> None:
        _, _, connections, session = self.known.pop(session_id)
        assert session.over
        assert all(each["closed"] for each in connections)
        self.gone.add(session_id)

    @rule()
    def sign_in(self) -> None:
        session_id = self.sessions.start()
        session = found(self.sessions, session_id)
        self.known[session_id] = [self.clock.now, self.clock.now, [], session]

    @rule(seconds=st.sampled_from([1.0, 60.0, 99.0, 101.0, 400.0]))
    def wait(self, seconds: float) -> None:
        self.clock.now += seconds

    @rule(data=st.data())
    def use(self, data: st.DataObject) -> None:
        if self.known:
            self._use(data.draw(st.sampled_from(sorted(self.known))))

    @rule(data=st.data())
    def connect(self, data: st.DataObject) -> None:
        if not self.known:
            return
        session_id = data.draw(st.sampled_from(sorted(self.known)))
        session = self._use(session_id)
        if session is not None:
            connection: dict[str, Any] = {"closed": False}
            connection["context"] = session.connected(lambda: connection.update(closed=True))
            connection["context"].__enter__()
            self.known[session_id][2].append(connection)

    @rule(data=st.data())
    def disconnect(self, data: st.DataObject) -> None:
        connected = sorted(
            each for each, (_, _, connections, _) in self.known.items() if connections
        )
        if not connected:
            return
        session_id = data.draw(st.sampled_from(connected))
        # The session counts as used until its last connection closes.
        if self._use(session_id) is not None:
            self.known[session_id][2].pop()["context"].__exit__(None, None, None)

    @rule(data=st.data())
    def renew(self, data: st.DataObject) -> None:
        if not self.known:
            return
        session_id = data.draw(st.sampled_from(sorted(self.known)))
        session = self._use(session_id)
        if session is not None:
            self.sessions.renew(session)
            self.known[session_id][0] = self.clock.now

    @rule(data=st.data())
    def sign_out(self, data: st.DataObject) -> None:
        if self.known:
            session_id = data.draw(st.sampled_from(sorted(self.known)))
            self.sessions.end(self.known[session_id][3])
            self._forget(session_id)

    @rule()
    def sign_out_everywhere(self) -> None:
        self.sessions.end_all()
        for session_id in tuple(self.known):
            self._forget(session_id)

    @rule()
    def sweep(self) -> None:
        over = [each for each in self.known if self._is_over(each)]
        self.sessions.sweep()
        for session_id in over:
            self._forget(session_id)
        for session_id, (_, _, connections, _) in self.known.items():
            if connections:
                self.known[session_id][1] = self.clock.now

    @rule(token=st.sampled_from([TOKEN, TOKEN, "another" + TOKEN]))
    def restart(self, token: str) -> None:
        """Restart, sometimes with another token: then no one is signed in any more."""
        if any(connections for _, _, connections, _ in self.known.values()):
            return
        old, self.sessions = self.sessions, table(self.clock, token)
        self.sessions.restore(old.ages())
        for session_id in tuple(self.known):
            if token != TOKEN or self._is_over(session_id):
                assert self.sessions.find(session_id) is None
                del self.known[session_id]
                self.gone.add(session_id)
            else:
                self.known[session_id][3] = found(self.sessions, session_id)
                self.known[session_id][1] = self.clock.now
        if token != TOKEN:
            self.sessions = table(self.clock)

    @invariant()
    def who_is_gone_stays_out(self) -> None:
        assert not any(self.sessions.find(each) for each in self.gone)

    @invariant()
    def nothing_that_is_kept_signs_in(self) -> None:
        for each in self.sessions.ages():
            assert self.sessions.find(each.digest.hex()) is None


AgainstAModel.TestCase.settings = settings(max_examples=25, stateful_step_count=25)
test_against_a_model = AgainstAModel.TestCase


def test_ids_have_at_least_128_random_bits() -> None:
    sessions = table(Clock())
    ids = {sessions.start() for _ in range(50)}
    assert len(ids) == 50
    assert all(6 * len(each) >= 128 for each in ids)


@pytest.mark.parametrize("session_id", ["", TOKEN, "\u00e9\udcff", 10_000 * "x"])
def test_an_invalid_id_finds_no_session(session_id: str) -> None:
    sessions = table(Clock())
    sessions.start()
    assert sessions.find(session_id) is None


def test_unused_sessions_are_dropped_first_when_full() -> None:
    clock = Clock()
    sessions = table(clock, most=3)
    driving, idle, third = (sessions.start() for _ in range(3))
    with found(sessions, driving).connected(lambda: pytest.fail("a page in use was cut off")):
        for each in (idle, third):
            clock.now += 1
            assert sessions.find(each)
        fourth = sessions.start()
        assert sessions.find(idle) is None
        assert all(sessions.find(each) for each in (driving, third, fourth))


async def test_a_job_ends_with_its_session_and_cleans_up() -> None:
    sessions = table(Clock())
    session = found(sessions, sessions.start())
    tidied = asyncio.Event()

    async def job() -> None:
        try:
            await asyncio.sleep(60)
        finally:
            tidied.set()

    running = asyncio.create_task(run_connected(session, job()))
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    sessions.end(session)
    async with asyncio.timeout(5):
        assert await running
    assert tidied.is_set()


async def test_a_job_that_ends_by_itself_does_not_report_a_session_end() -> None:
    sessions = table(Clock())
    session = found(sessions, sessions.start())
    assert not await run_connected(session, asyncio.sleep(0))

    async def gives_up() -> None:
        raise asyncio.CancelledError

    with pytest.raises(asyncio.CancelledError):
        await run_connected(session, gives_up())
    running = asyncio.create_task(run_connected(session, asyncio.sleep(60)))
    await asyncio.sleep(0)
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    assert not session.closers

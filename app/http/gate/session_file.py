"""File that keeps sessions and read-only links across restarts, so that open pages go on."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from pathlib import Path

import structlog
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from app.http.gate.sessions import SessionAge, Sessions
from app.server.data_files import write_whole
from observer.errors import DynamicObserverError

log = structlog.get_logger(__name__)

# In the data folder.
SESSION_FILE = "sessions.json"

_LOOK_EVERY_S = 30.0
# After a crash, the times of last use are only as exact as this.
_LOOKS_PER_SAVE = 10
_MOST_BYTES = 1024 * 1024


class _Kept(BaseModel):
    """Session in the file. Times are seconds since 1970: they must hold after a reboot."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    digest: str = Field(pattern=r"^[0-9a-f]{64}$")
    started: float = Field(allow_inf_nan=False)
    used: float = Field(allow_inf_nan=False)
    # Id of the read-only link that it was opened with.
    link: str | None = None


class _KeptLink(BaseModel):
    """Read-only link in the file; its token is derived from the operators', which is not stored."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: str = Field(pattern=r"^[0-9a-f]{16}$")
    made: float = Field(allow_inf_nan=False)


class _Content(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    sessions: list[_Kept]
    links: list[_KeptLink] = []


class SessionFile:
    """File of the sessions.

    If it cannot be written, sessions end with the process; nothing else is affected. But no
    signed-out session and no revoked link may come back: if the file cannot be replaced, it is
    deleted.

    Args:
        path: None if the token, too, ends with the process.
        wall_clock: seconds since 1970.
    """

    def __init__(
        self, path: Path | None, sessions: Sessions, wall_clock: Callable[[], float]
    ) -> None:
        self._path = path
        self._sessions = sessions
        self._wall_clock = wall_clock
        self._writing = asyncio.Lock()
        # Digests of sessions, ids of links.
        self._in_file: set[bytes | str] = set()

    def load(self) -> None:
        """Restore the sessions of an earlier process, or none if the file is damaged."""
        if self._path is None:
            return
        try:
            with self._path.open("rb") as file:
                content = _Content.model_validate_json(file.read(_MOST_BYTES))
        except FileNotFoundError:
            return
        except (OSError, ValidationError) as error:
            log.warning("sessions_not_read", file=str(self._path), reason=str(error))
            return
        now = self._wall_clock()
        ages = [
            SessionAge(bytes.fromhex(each.digest), now - each.started, now - each.used, each.link)
            for each in content.sessions
        ]
        links = [(each.id, each.made) for each in content.links]
        self._in_file = _keys(ages, links)
        self._sessions.links.restore(links)
        self._sessions.restore(ages)

    async def save(self) -> None:
        """Write the sessions as they are now."""
        if self._path is None:
            return
        async with self._writing:
            now, ages = self._wall_clock(), self._sessions.ages()
            links = self._sessions.links.kept()
            kept = [
                _Kept(
                    digest=a.digest.hex(),
                    started=now - a.age_s,
                    used=now - a.unused_s,
                    link=a.link,
                )
                for a in ages
            ]
            content = _Content(
                sessions=kept, links=[_KeptLink(id=id, made=made) for id, made in links]
            )
            if await asyncio.to_thread(self._write, self._path, content.model_dump_json()):
                self._in_file = _keys(ages, links)
            elif self._in_file - _keys(ages, links):
                await asyncio.to_thread(self._delete, self._path)
                self._in_file = set()

    async def keep(self) -> None:
        """End sessions in time and keep the file up to date, until cancelled."""
        looks = 0
        while True:
            await asyncio.sleep(_LOOK_EVERY_S)
            self._sessions.sweep()
            looks += 1
            if looks % _LOOKS_PER_SAVE == 0:
                await self.save()

    @staticmethod
    def _write(path: Path, text: str) -> bool:
        try:
            write_whole(path, text)
        except DynamicObserverError as error:
            log.warning("sessions_not_saved", reason=str(error))
            return False
        return True

    @staticmethod
    def _delete(path: Path) -> None:
        try:
            with contextlib.suppress(FileNotFoundError):
                path.unlink()
        except OSError as error:
            log.error(
                "signed_out_session_still_in_file",
                file=str(path),
                reason=str(error),
                next="delete the file before the next start",
            )


def _keys(ages: list[SessionAge], links: list[tuple[str, float]]) -> set[bytes | str]:
    return {*(each.digest for each in ages), *(id for id, _ in links)}

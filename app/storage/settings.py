"""Small values by key, each of them JSON."""

from __future__ import annotations

from typing import Any

from sqlalchemy import delete
from sqlalchemy.orm import Session

from app.storage.database import Database
from app.storage.models import Setting


class SettingTables(Database):
    """Table of settings that the server or a user chose, restored after a restart."""

    def get_setting(self, key: str, default: Any = None) -> Any:
        with self._reading() as session:
            return read_setting(session, key, default)

    def set_setting(self, key: str, value: Any) -> None:
        """Store a JSON value (finite numbers only); ``None`` deletes the key."""
        with self._writing() as session:
            write_setting(session, key, value)


def read_setting(session: Session, key: str, default: Any = None) -> Any:
    row = session.get(Setting, key)
    return default if row is None else row.value


def write_setting(session: Session, key: str, value: Any) -> None:
    """Write within a caller's transaction, so that it is committed together with other changes."""
    if value is None:
        session.execute(delete(Setting).where(Setting.key == key))
    else:
        session.merge(Setting(key=key, value=value))

"""Search for runs by words, the same on every database.

SQLite folds only ASCII letters and PostgreSQL folds by its locale, so the searched text is folded
here and stored beside the original.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable

from sqlalchemy import ColumnElement, and_, select

from app.storage.models import Run, RunTag


def folded(*texts: str) -> str:
    """Return the texts in searchable form: lower case, with compatible characters made equal."""
    return unicodedata.normalize("NFKC", "\n".join(texts)).casefold()


def matching(text: str, tags: Iterable[str], deleted: bool) -> ColumnElement[bool]:
    """Return the condition for runs with every word of ``text`` and every tag."""
    conditions: list[ColumnElement[bool]] = [
        Run.deleted_at.is_not(None) if deleted else Run.deleted_at.is_(None)
    ]
    conditions += [Run.searched.contains(word, autoescape=True) for word in folded(text).split()]
    conditions += [Run.id.in_(select(RunTag.run_id).where(RunTag.tag == tag)) for tag in {*tags}]
    return and_(*conditions)

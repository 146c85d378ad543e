"""The log: what has happened that a person should know."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Query
from fastapi.requests import HTTPConnection

from app.contract.journal import LogPage
from app.http.api.refusals import refusals
from app.server.journal import Journal

router = APIRouter(tags=["status"])


def _journal(connection: HTTPConnection) -> Journal:
    journal = connection.app.state.journal
    assert isinstance(journal, Journal)
    return journal


TheJournal = Annotated[Journal, Depends(_journal)]


@router.get("/log", summary="What has happened", responses=refusals(422))
async def get_log(
    journal: TheJournal,
    after: Annotated[int, Query(ge=0, le=2**53, description="Only entries above this number.")] = 0,
) -> LogPage:
    """Since the server started; the live socket sends later entries."""
    return LogPage(journal.since(after))

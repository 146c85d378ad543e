"""Browsers that have signed in."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import httpx

COOKIE = "dynamic_observer_session"


@asynccontextmanager
async def browser(served: Any, token: str) -> AsyncIterator[httpx.AsyncClient]:
    """A client that has signed in, and has the cookie."""
    async with served.anonymous() as client:
        assert (await client.get("/", params={"token": token})).status_code == 303
        assert (await client.get("/api/status")).is_success
        yield client


def cookie(client: httpx.AsyncClient) -> dict[str, str]:
    return {"Cookie": f"{COOKIE}={client.cookies[COOKIE]}"}

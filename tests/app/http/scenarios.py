"""What a test does at a served application, in an event loop of its own."""

from __future__ import annotations

import asyncio
from typing import Any

JSON = {"Content-Type": "application/json"}


def run(serve: Any, scenario: Any, **settings: Any) -> None:
    """``scenario(served)`` to its end; ``settings`` are the server's."""

    async def serving() -> None:
        async with asyncio.timeout(90), serve(**settings) as served:
            await scenario(served)

    asyncio.run(serving())

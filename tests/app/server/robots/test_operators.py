"""Operators: their names and leases."""

from __future__ import annotations

import asyncio
from typing import Any

from app.contract.drive import ReleaseLease, TakeLease
from app.server.robots.operators import Operators


async def test_a_lease_granted_after_its_operator_left_is_released() -> None:
    asked: list[Any] = []
    answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()

    async def ask(command: Any) -> dict[str, Any]:
        asked.append(command)
        return await answer if isinstance(command, TakeLease) else {}

    background: list[Any] = []
    operators = Operators(ask, lambda work: background.append(asyncio.ensure_future(work)))
    operator = operators.join("Anna", lambda *_: None)
    taking = asyncio.create_task(operators.take(operator, "observer", takeover=False))
    await asyncio.sleep(0)
    operators.leave(operator)
    answer.set_result({"lease": "late"})
    await taking
    await asyncio.gather(*background)
    assert [type(command).__name__ for command in asked] == ["TakeLease", "ReleaseLease"]
    assert asked[-1].lost
    assert operators.holder("observer") is None


async def test_an_operator_who_leaves_is_told_apart_from_one_who_releases() -> None:
    asked: list[Any] = []

    async def ask(command: Any) -> str:
        asked.append(command)
        return "lease"

    background: list[Any] = []
    operators = Operators(ask, lambda work: background.append(asyncio.ensure_future(work)))
    operator = operators.join("Anna", lambda *_: None)
    await operators.take(operator, "observer", takeover=False)
    await operators.release(operator, "observer")
    await operators.take(operator, "observer", takeover=False)
    operators.leave(operator)
    await asyncio.gather(*background)
    released = [command.lost for command in asked if isinstance(command, ReleaseLease)]
    assert released == [False, True]


def test_every_operator_gets_a_unique_name() -> None:
    async def ask(_: Any) -> dict[str, Any]:
        return {}

    operators = Operators(ask, lambda _: None)
    given = ["Anna", "Anna", "Anna (4)", "Anna", None, "operator 6", "operator 6", "\x07 \n"]
    names = [operators.join(name, lambda *_: None).name for name in given]
    assert names[:2] == ["Anna", "Anna (2)"]
    assert len(set(names)) == len(given)

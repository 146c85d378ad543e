"""The bench of scripted robots, and a real drive process with emulated ones."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator

import pytest

from app.contract.drive import SIGHT_NAME
from observer.simulation.robots.emulated import EmulatedRobot
from observer.simulation.robots.serving import serve_tcp

from .driving import MODELS, Drive, Eyes, Robots
from .scripted import Bench


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def eyes(slots: dict[str, int]) -> Iterator[Eyes]:
    eyes = Eyes(slots[SIGHT_NAME])
    yield eyes
    eyes.close()


@pytest.fixture
def robots() -> Iterator[Robots]:
    with contextlib.ExitStack() as stack:
        yield {
            role: stack.enter_context(serve_tcp(EmulatedRobot(model, now=time.monotonic())))
            for role, model in MODELS.items()
        }


@pytest.fixture
def drive(slots: dict[str, int], eyes: Eyes) -> Iterator[Drive]:
    del eyes
    drive = Drive(slots)
    yield drive
    drive.close()

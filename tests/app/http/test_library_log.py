"""Libraries' log messages about clients, in lines that a person can read."""

from __future__ import annotations

import io
import logging

import pytest

from app.http.library_log import LibraryLog

from .clock import Clock


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def log(clock: Clock) -> tuple[logging.Logger, io.StringIO]:
    told = io.StringIO()
    handler = logging.StreamHandler(told)
    handler.addFilter(LibraryLog(clock))
    logger = logging.Logger("library")
    logger.addHandler(handler)
    return logger, told


def test_repeated_messages_are_counted(
    log: tuple[logging.Logger, io.StringIO], clock: Clock
) -> None:
    logger, told = log
    for _ in range(5000):
        logger.warning("Invalid HTTP request received.")
    logger.warning("something else")
    clock.now += 11.0
    logger.warning("Invalid HTTP request received.")
    assert told.getvalue().splitlines() == [
        "Invalid HTTP request received.",
        "something else",
        "Invalid HTTP request received. (4999 more like it before)",
    ]


def test_client_errors_have_no_traceback(log: tuple[logging.Logger, io.StringIO]) -> None:
    logger, told = log
    for error in (ConnectionResetError("reset"), UnicodeDecodeError("utf-8", b"x", 0, 1, "bad")):
        try:
            raise error
        except (OSError, UnicodeError):
            logger.exception("data of %s", type(error).__name__)
    assert len(told.getvalue().splitlines()) == 2
    assert "Traceback" not in told.getvalue()


def test_a_server_error_keeps_its_traceback(log: tuple[logging.Logger, io.StringIO]) -> None:
    logger, told = log
    try:
        raise ValueError("ours")
    except ValueError:
        logger.exception("Exception in ASGI application")
    assert "Traceback" in told.getvalue()

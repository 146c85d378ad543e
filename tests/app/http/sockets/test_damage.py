"""Damaged messages of operators: a known message with finite numbers, or one sentence."""

from __future__ import annotations

import math

from hypothesis import example, given

from app.http.sockets.connections import BadMessage
from app.http.sockets.drive_messages import Command, Pong, read_message

from ....damage import damaged_text, examples, hostile_text, read_or_refused

MESSAGES = (
    '{"type": "drive", "role": "observer", "sequence": 3, "time": 1234.5, "speed_mps": 0.2,'
    ' "turn_rate_radps": -0.1}',
    '{"type": "take", "role": "obstacle", "takeover": true}',
    '{"type": "pong", "id": 7, "time": 1.5}',
    '{"type": "stop"}',
)
WORDS = ('"type": ', '"drive"', "{", "}", "[]", "null", "true")


@examples(100)
@given(damaged_text(MESSAGES, WORDS) | hostile_text(WORDS + MESSAGES))
@example('{"type": "pong", "id": 7, "time": ' + "9" * 5000 + "}")
@example('{"type": ' + "[" * 1500 + "}")
@example('{"type": ["drive"], "role": {"a": 1}}')
def test_a_damaged_message_is_refused_or_finite(text: str) -> None:
    told = read_or_refused(lambda: read_message(text), BadMessage)
    if isinstance(told, Command):
        assert all(map(math.isfinite, told.velocity or ()))
    if isinstance(told, Command | Pong):
        assert math.isfinite(told.stamp)

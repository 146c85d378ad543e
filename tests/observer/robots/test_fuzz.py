"""A small number of damaged streams; ``fuzz.py`` itself runs a million."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType

import pytest

_PACKETS = int(os.environ.get("FUZZED_PACKETS", "10000"))
# A session takes a thousand times as long as a packet.
_SESSIONS = max(1, _PACKETS // 1000)
# Two damaged bytes in one column of the 16-bit words cancel with probability 1/255; a
# 9-byte packet with 1 % noise has such a pair about once in 10^5.
_LET_THROUGH = 1e-4


@pytest.fixture(scope="module")
def fuzzing() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fuzz", Path(__file__).with_name("fuzz.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("make", "reads"), [("some_status", "read_status"), ("some_command", "read_velocity")]
)
def test_noise_is_almost_never_misread_as_a_packet(
    fuzzing: ModuleType, make: str, reads: str
) -> None:
    tally = fuzzing.fuzz(_PACKETS, getattr(fuzzing, make), getattr(fuzzing, reads))
    sys.stdout.write(f"{make}: {tally}\n")
    assert tally.sent == _PACKETS
    assert tally.raised == 0
    assert tally.whole > 0.4 * _PACKETS
    assert tally.misread <= max(1, _LET_THROUGH * _PACKETS)


def test_without_noise_every_packet_arrives(fuzzing: ModuleType) -> None:
    tally = fuzzing.fuzz(1000, fuzzing.some_status, fuzzing.read_status, noise=0.0)
    assert (tally.whole, tally.lost, tally.altered) == (1000, 0, 0)


# Commands that get through, commands of which few do, and noise with hardly any.
@pytest.mark.parametrize("make", ["any_command", "still_command", "some_status"])
@pytest.mark.parametrize("noise", [0.01, 0.2])
def test_a_robot_survives_noise_without_obeying_it_or_going_deaf(
    fuzzing: ModuleType, make: str, noise: float
) -> None:
    tally = fuzzing.fuzz_robot(_SESSIONS, getattr(fuzzing, make), noise)
    sys.stdout.write(f"{make}: {tally}\n")
    assert (tally.raised, tally.unsent, tally.unasked) == (0, 0, 0)
    assert (tally.deaf, tally.restless) == (0, 0)
    # Only packets with commands count; few status packets can be read as one.
    assert tally.obeyed > 0.05 * tally.sent or make == "some_status"


def test_without_noise_a_robot_obeys_every_command(fuzzing: ModuleType) -> None:
    tally = fuzzing.fuzz_robot(5, fuzzing.still_command, noise=0.0)
    assert tally.obeyed == tally.sent > 0

"""Names of sources, cameras, ports and boards as people type them are understood or refused."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from observer.calibration.boards.board import Board, parse_board_size
from observer.coppeliasim.address import parse_address
from observer.errors import DynamicObserverError, InputError
from observer.opening import (
    exclusive_world,
    live_devices,
    open_source,
    shown_spec,
)
from observer.parameters import Parameters, effective, preset
from observer.robot_opening import check_port
from observer.sources.cameras.settings import parse_settings
from observer.sources.cameras.spec import parse_devices, parse_urls, swapped_spec

from ..damage import damaged_text, examples, hostile_text, read_or_refused

# None of these opens anything: no such scenario, file, device or host exists.
SPECS = (
    "simulated:nowhere?seed=7", "video:/nowhere/l.mp4,/nowhere/r.mp4", "/nowhere/left",
    "/nowhere/recording.mcap", "coppeliasim:a b:23000",
)  # fmt: skip
DEVICES = ("0,1?size=640x480&rate=30&format=MJPG&exposure=156&gain=auto&power_line=50",
           "sbs:/dev/v4l/by-path/a?white_balance=4600&focus=0")  # fmt: skip
URLS = ("rtsp://user:secret@host:554/a?password=b,http://host/right", "sbs:rtsp://[::1]/both")
PORTS = ("/dev/ttyUSB0", "socket://192.168.1.20:8101", "external:0.0.0.0:9000",
         "coppeliasim:localhost:23000/PioneerP3DX")  # fmt: skip
KINDS = ("simulated:", "?seed=", "video:", "camera:", "sbs:", "rtsp://", ",", "coppeliasim:")


@examples(80)
@given(damaged_text(SPECS, KINDS) | hostile_text(KINDS))
@example("simulated:lab?seed=" + "9" * 5000)
@example("simulated:nowhere\0.yaml")
@example("/nowhere\0")
@example("video:\0,b")
@example("coppeliasim:h:" + "9" * 5000)
def test_any_source_name_is_opened_or_refused(spec: str) -> None:
    # Real cameras and scenarios that take a second to build are left to other tests.
    if "camera" in spec or spec.lower().startswith(("simulated:?", "simulated:lab")):
        spec = spec.replace("camera", "kamera").replace("?seed=0", "?seed=x")
    read_or_refused(lambda: _opened_and_closed(spec), DynamicObserverError)


def _opened_and_closed(spec: str) -> None:
    open_source(spec).source.close()


@examples(80)
@given(damaged_text(DEVICES, ("size=", "rate=", "&", "camera:")) | hostile_text(("0,1", "?", "&")))
@example("9" * 5000 + ",1")
@example("0,/dev/\0")
@example("0,1?size=640%0Ax480")
@example("0,1?a%0Ab=1")
def test_camera_names_are_parsed_or_refused(rest: str) -> None:
    spec = read_or_refused(lambda: parse_devices(rest), InputError)
    if spec is not None:
        assert 1 <= len(spec.targets) <= 2
        assert spec.settings.rate is None or 1 <= spec.settings.rate <= 1000
    read_or_refused(lambda: swapped_spec(f"camera:{rest}"), InputError)
    live_devices(f"camera:{rest}")


@examples(80)
@given(damaged_text(URLS, ("rtsp://", "http://", "@", ",")) | hostile_text(("rtsp://", ",", "@")))
@example("rtps://user:secret@host/left,rtps://host/right")
@example("rtsp://host/1,rtsp://user:secret@host/2,rtsp://host/3")
@example("sbs:rtsp://user:secret@host:port/both")
@example("rtsp://rtsp://user:secret@host/left,rtsp://host/right")
def test_camera_addresses_are_parsed_or_refused_and_shown_without_passwords(text: str) -> None:
    spec = read_or_refused(lambda: parse_urls(text), InputError)
    for shown in (shown_spec(text), *([] if spec is None else [spec.text])):
        named = text.startswith(("rtsp:", "rtps:", "http:", "sbs:"))
        assert not named or text.count("//user:secret@") != 1 or "user:secret" not in shown
    live_devices(text)
    exclusive_world(text)


@examples(60)
@given(damaged_text([each.partition("?")[2] for each in DEVICES], ("size=", "&", "=")))
def test_camera_settings_are_parsed_or_refused(query: str) -> None:
    read_or_refused(lambda: parse_settings(query), InputError)


@examples(80)
@given(damaged_text(PORTS, ("socket://", "external:", ":")) | hostile_text(PORTS))
def test_a_robot_port_is_accepted_or_refused(port: str) -> None:
    read_or_refused(lambda: check_port(port), InputError)


@examples(40)
@given(damaged_text(["localhost:23000", "[::1]:1"]) | hostile_text(("localhost", ":")))
@example("h:" + "9" * 5000)
def test_a_simulator_address_is_parsed_or_refused(text: str) -> None:
    address = read_or_refused(lambda: parse_address(text), InputError)
    if address is not None:
        assert parse_address(str(address)) == address


@examples(40)
@given(damaged_text(["9x6", "11 × 8"]) | hostile_text(("9", "x", "6")))
@example("9x" + "9" * 5000)
@example("9" * 4000 + "x6")
@example("a\nb")
def test_a_board_size_is_parsed_or_refused(text: str) -> None:
    def board() -> Board:
        columns, rows = parse_board_size(text)
        return Board("chessboard", columns, rows)

    made = read_or_refused(board, InputError)
    assert made is None or parse_board_size(f"{made.columns}x{made.rows}") == (
        made.columns,
        made.rows,
    )


_values: st.SearchStrategy[object] = (
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20)
    | st.just(10**400) | st.just([1]) | st.just({"a": 1})
)  # fmt: skip


@pytest.mark.parametrize("name", ["default", "paper"])
@examples(40)
@given(st.data())
def test_any_parameter_values_are_valid_or_refused(name: str, data: st.DataObject) -> None:
    names = st.sampled_from(list(Parameters().flat())) | st.text(max_size=20)
    changes = data.draw(st.dictionaries(names, _values, max_size=4))
    made = read_or_refused(lambda: effective(preset(name), changes), InputError)
    if made is not None:
        assert Parameters().changed(made.flat()) == made

"""Which cameras a text names, and which settings they accept."""

from __future__ import annotations

from pathlib import Path

import pytest

from observer.errors import SourceError
from observer.opening import open_source, shown_spec
from observer.sources.cameras.settings import CameraSettings, parse_settings
from observer.sources.cameras.spec import (
    CameraTarget,
    parse_devices,
    parse_urls,
    swapped_spec,
    without_password,
)


def test_all_settings_are_read() -> None:
    assert parse_settings(
        "size=640x480&rate=30&format=mjpg&exposure=156&gain=10&white_balance=4600&focus=0"
        "&power_line=50"
    ) == CameraSettings((640, 480), 30.0, "MJPG", 156, 10, 4600, 0, 50)
    automatic = parse_settings("exposure=auto&gain=auto&white_balance=auto&focus=auto")
    assert {automatic.exposure, automatic.gain, automatic.focus} == {"auto"}
    assert parse_settings("power_line=off").power_line_hz == 0
    assert parse_settings("") == CameraSettings()


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("sharpness=3", "no camera setting 'sharpness'; the settings are size, rate, format"),
        ("rate=30&rate=25", "rate is given twice"),
        ("size=640", "size=640 is not valid; use WIDTHxHEIGHT"),
        ("size=1x1", "16 to 16384 pixels"),
        ("size=-640x480", "WIDTHxHEIGHT"),
        ("size=auto", "WIDTHxHEIGHT"),
        ("rate=nan", "frames per second from 1 to 1000"),
        ("rate=inf", "frames per second from 1 to 1000"),
        ("rate=", "frames per second"),
        ("format=MJPEG", "four characters"),
        ("exposure=long", "auto or a whole number from 1"),
        ("exposure=1e3", "auto or a whole number from 1"),
        ("gain=-1", "auto or a whole number from 0"),
        ("white_balance=3", "from 1000 to 20000 kelvin"),
        ("focus=٣", "auto or a whole number"),
        ("power_line=55", "50, 60, off or auto"),
    ],
)
def test_an_invalid_setting_is_refused_by_name(query: str, words: str) -> None:
    with pytest.raises(SourceError) as refusal:
        parse_settings(query)
    assert words in str(refusal.value)


def test_devices_are_named_by_number_or_path(tmp_path: Path) -> None:
    spec = parse_devices("0,1?rate=25", tmp_path)
    assert [target.address for target in spec.targets] == ["/dev/video0", "/dev/video1"]
    assert [target.name for target in spec.targets] == ["/dev/video0", "/dev/video1"]
    assert spec.settings.rate == 25.0
    assert spec.text == "camera:0,1?rate=25"
    assert not spec.network
    both = parse_devices("sbs:/dev/video2", tmp_path)
    assert [target.address for target in both.targets] == ["/dev/video2"]


def test_a_device_is_called_by_its_stable_name(tmp_path: Path) -> None:
    device = tmp_path / "video7"
    device.touch()
    by_path = tmp_path / "by-path"
    by_path.mkdir()
    link = by_path / "pci-0000:00:14.0-usb-0:2:1.0-video-index0"
    link.symlink_to(device)
    spec = parse_devices(f"{device},/dev/video1", by_path)
    assert spec.targets[0] == CameraTarget(str(device), str(link), network=False)
    assert parse_devices(f"{link},/dev/video1", by_path).targets[0].address == str(link)
    with pytest.raises(SourceError, match="are the same camera"):
        parse_devices(f"{device},{link}", by_path)


@pytest.mark.parametrize(
    ("rest", "words"),
    [
        ("0", "takes two devices"),
        ("", "takes two devices"),
        ("0,1,2", "takes two devices"),
        ("left,right", "'left' is not a camera"),
        ("0,-1", "'-1' is not a camera"),
        ("sbs:", "'' is not a camera"),
        ("0,0", "the same camera"),
        ("0,1?size=big", "size=big is not valid"),
    ],
)
def test_an_invalid_pair_of_devices_is_refused(rest: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(SourceError) as refusal:
        parse_devices(rest, tmp_path)
    assert words in str(refusal.value)


def test_addresses_may_contain_commas_queries_and_passwords() -> None:
    left = "rtsp://user:p@ss,word@10.0.0.1:554/a,b?channel=1&subtype=0"
    right = "https://10.0.0.2/video.mjpg?usr=me&pwd=s3cret&size=1,2"
    spec = parse_urls(f"{left}, {right}")
    assert [target.address for target in spec.targets] == [left, right]
    assert [target.name for target in spec.targets] == [
        "rtsp://10.0.0.1:554/a,b?channel=1&subtype=0",
        "https://10.0.0.2/video.mjpg?size=1%2C2",
    ]
    assert spec.network
    for text in (spec.text, repr(spec), str(spec.targets)):
        assert not any(secret in text for secret in ("p@ss", "user", "s3cret", "=me"))
    assert parse_urls("sbs:http://a/b").text == "sbs:http://a/b"
    assert parse_urls("sbs_swapped:http://a/b").text == "sbs_swapped:http://a/b"
    assert parse_urls("sbs_swapped:http://a/b").swapped
    assert shown_spec(f"{left}, {right}") == spec.text
    assert shown_spec(left) == "rtsp://10.0.0.1:554/a,b?channel=1&subtype=0"
    assert shown_spec("simulated:lab?seed=2") == "simulated:lab?seed=2"


@pytest.mark.parametrize(
    ("text", "swapped"),
    [
        ("camera:0,1", "camera:1,0"),
        ("camera:0, /dev/video2?focus=0&rate=30", "camera:/dev/video2,0?focus=0&rate=30"),
        ("camera:sbs:0?rate=30", "camera:sbs_swapped:0?rate=30"),
        ("rtsp://u:p@a/x,y,http://b/z", "http://b/z,rtsp://u:p@a/x,y"),
        ("sbs:rtsp://a/x", "sbs_swapped:rtsp://a/x"),
    ],
)
def test_left_and_right_are_swapped_and_swapped_back(text: str, swapped: str) -> None:
    assert swapped_spec(text) == swapped
    assert swapped_spec(swapped) == text.replace(", ", ",")


def test_only_live_cameras_can_be_swapped() -> None:
    with pytest.raises(SourceError, match="only live cameras"):
        swapped_spec("video:a.mp4,b.mp4")


def test_an_address_without_secrets_is_unchanged() -> None:
    for url in ("rtsp://cam/stream", "http://[::1]:8080/v?a=1&b=%20", "http://h/x?flag"):
        assert without_password(url) == url


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rtsp://a:b@host/x", "give two network cameras, as in rtsp://LEFT,rtsp://RIGHT"),
        ("rtsp://h/x,rtsp://h/x", "the same camera"),
        ("sbs:http://a/1,http://a/2", "takes the address"),
        ("http://,http://h/x", "incomplete"),
        ("http://h:99999/x,http://h/y", "incomplete"),
        ("sbs:ftp://h/x", "incomplete"),
    ],
)
def test_invalid_addresses_are_refused(text: str, words: str) -> None:
    with pytest.raises(SourceError) as refusal:
        parse_urls(text)
    assert words in str(refusal.value)
    assert "a:b" not in str(refusal.value)


def test_open_source_reports_devices_that_are_not_connected() -> None:
    with pytest.raises(SourceError, match=r"the left camera \(/dev/video98\) is not connected"):
        open_source("camera:98,99?format=MJPG")
    with pytest.raises(SourceError, match=r"\(/dev/video98\) is not connected; doctor lists"):
        open_source("camera:sbs:98")

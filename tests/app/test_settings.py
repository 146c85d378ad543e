"""Settings: where they come from, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from app.settings import Settings, default_data_folder


def test_defaults_listen_on_this_machine_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", "/somewhere")
    settings = Settings()
    assert (settings.host, settings.port, settings.source) == ("127.0.0.1", 8080, "simulated:lab")
    assert settings.data == Path("/somewhere/dynamic-observer")
    assert settings.database_location == Path("/somewhere/dynamic-observer/observer.sqlite")
    assert not settings.tls


def test_a_relative_data_home_is_ignored(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", "relative")
    monkeypatch.setenv("HOME", "/home/somebody")
    assert default_data_folder() == Path("/home/somebody/.local/share/dynamic-observer")


def test_arguments_override_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DYNAMIC_OBSERVER_PORT", "9000")
    monkeypatch.setenv("DYNAMIC_OBSERVER_ALLOWED_HOSTS", "Lab.example, other.example:8443")
    settings = Settings(host="0.0.0.0")
    assert settings.port == 9000
    assert settings.allowed_hosts == ("lab.example", "other.example:8443")
    assert Settings(port=9001).port == 9001


@pytest.mark.parametrize(
    "wrong",
    [
        {"unknown": 1},
        {"port": 70000},
        {"port": -1},
        {"source": ""},
        {"allowed_hosts": ("*",)},
        {"allowed_hosts": ("http://lab",)},
        {"tls_cert": Path("a")},
        {"viewer_rate_hz": float("nan")},
        {"log_level": "loud"},
    ],
    ids=str,
)
def test_invalid_settings_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Settings(**wrong)


def test_a_renamed_variable_is_refused_with_its_present_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("DYNAMIC_OBSERVER_RING_AT_GUARD_STOPS", "0")
    renamed = "RING_AT_GUARD_STOPS has been renamed to DYNAMIC_OBSERVER_CLIPS_AT_GUARD_STOPS"
    with pytest.raises(ValidationError, match=renamed):
        Settings()


def test_a_mistyped_variable_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DYNAMIC_OBSERVER_PROT", "9000")
    with pytest.raises(ValidationError, match="DYNAMIC_OBSERVER_PROT is not a setting"):
        Settings()

"""Settings of the server: from arguments, then environment, then defaults.

The person who starts the server may choose them.

Environment variables are named ``DYNAMIC_OBSERVER_`` and the setting, as in
``DYNAMIC_OBSERVER_PORT``; several host names are separated by commas.
"""

from __future__ import annotations

import ipaddress
import os
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from observer.errors import TruthError

# Files and folders in the data folder, besides those of runs and truths (app.storage.folder).
DATABASE_FILE = "observer.sqlite"
RIG_FILE = "rig.yaml"
PROGRAMME_FOLDER = "programmes"
CHECK_FOLDER = "guard-checks"
ENVIRONMENT_PREFIX = "DYNAMIC_OBSERVER_"

# Former names, refused with the present one.
_RENAMED = {"ring_at_guard_stops": "clips_at_guard_stops"}
_MEGABYTE = 1024 * 1024


def default_data_folder() -> Path:
    """Return the folder for data that must outlive the program (XDG base directories)."""
    base = os.environ.get("XDG_DATA_HOME", "")
    # The specification says to ignore relative paths.
    root = Path(base) if base.startswith("/") else Path.home() / ".local" / "share"
    return root / "dynamic-observer"


def is_every_address(host: str) -> bool:
    """Return whether a host means every address, as 0.0.0.0 and :: do."""
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:
        return False


class Settings(BaseSettings):
    """The server's settings. Unknown keys are refused, wherever they come from.

    Attributes:
        source: what is opened first.
        truth: live motion capture to listen to; default: the last choice.
        host, port: where to listen; port 0 takes a free one.
        data: folder of database, recordings and truths. database: the URL of another database,
            a PostgreSQL server's for example; recordings and truths stay in the folder.
        token_file: keeps the sign-in token across restarts; without it every start makes a new one.
        allowed_hosts: further names under which browsers may reach the server; a name with a
            port is allowed with this port only.
        tls_cert, tls_key: PEM files; both or neither.
        session_unused_hours: a browser is signed out after this long without an open page; three
            days outlast a weekend. session_days: it must sign in again after this long.
        viewer_points, viewer_rate_hz: the 3D scene's cloud: points drawn, updates per second.
        strict: whether to end at the start if something configured cannot be used, instead of
            serving with a warning.
        clips_at_guard_stops: whether the last half minute is saved when the guard stops a robot.
        calibration_max_bytes: largest calibration file. images_max_bytes: largest archive of
            images to calibrate with. truth_max_bytes: largest truth file.
        body_max_bytes: largest other request.
    """

    model_config = SettingsConfigDict(
        env_prefix=ENVIRONMENT_PREFIX, extra="forbid", frozen=True, hide_input_in_errors=True
    )

    source: str = Field("simulated:lab", min_length=1)
    truth: str | None = None
    host: str = Field("127.0.0.1", min_length=1)
    port: int = Field(8080, ge=0, le=65535)
    data: Path = Field(default_factory=default_data_folder)
    database: str | None = None
    token_file: Path | None = None
    allowed_hosts: Annotated[tuple[str, ...], NoDecode] = ()
    tls_cert: Path | None = None
    tls_key: Path | None = None
    session_unused_hours: float = Field(72.0, ge=0.1, le=8760.0, allow_inf_nan=False)
    session_days: float = Field(30.0, ge=0.1, le=365.0, allow_inf_nan=False)
    viewer_points: int = Field(12_000, ge=500, le=20_000)
    viewer_rate_hz: float = Field(10.0, ge=0.5, le=30.0, allow_inf_nan=False)
    calibration_max_bytes: int = Field(_MEGABYTE, ge=1024, le=64 * _MEGABYTE)
    images_max_bytes: int = Field(256 * _MEGABYTE, ge=1024, le=2048 * _MEGABYTE)
    truth_max_bytes: int = Field(512 * _MEGABYTE, ge=1024, le=4096 * _MEGABYTE)
    body_max_bytes: int = Field(256 * 1024, ge=1024, le=64 * _MEGABYTE)
    strict: bool = False
    clips_at_guard_stops: bool = True
    log_level: Literal["debug", "info", "warning", "error"] = "warning"

    @field_validator("data")
    @classmethod
    def _whole_path(cls, value: Path) -> Path:
        return value.expanduser().absolute()

    @field_validator("truth")
    @classmethod
    def _live_truth(cls, value: str | None) -> str | None:
        if value is not None:
            # This imports numpy, which the command line avoids as long as possible.
            from observer.truth.live.opening import check_live

            try:
                check_live(value)
            except TruthError as error:
                raise ValueError(str(error)) from error
        return value

    @field_validator("allowed_hosts", mode="before")
    @classmethod
    def _split_hosts(cls, value: Any) -> Any:
        if isinstance(value, str):
            return tuple(part.strip() for part in value.split(",") if part.strip())
        return value

    @field_validator("allowed_hosts")
    @classmethod
    def _plain_hosts(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for name in value:
            if not name or "/" in name or "*" in name or any(c.isspace() for c in name):
                raise ValueError(f"give a host name such as lab.example, not {name!r}")
        return tuple(name.lower() for name in value)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_environment(cls, values: Any) -> Any:
        # pydantic-settings looks only for names it knows, so a mistyped one would do nothing.
        known = {f"{ENVIRONMENT_PREFIX}{name}".upper() for name in cls.model_fields}
        unknown = sorted(
            name
            for name in os.environ
            if name.upper().startswith(ENVIRONMENT_PREFIX) and name.upper() not in known
        )
        if unknown:
            present = _RENAMED.get(unknown[0][len(ENVIRONMENT_PREFIX) :].lower())
            if present is not None:
                raise ValueError(
                    f"the environment variable {unknown[0]} has been renamed to "
                    f"{ENVIRONMENT_PREFIX}{present.upper()}"
                )
            raise ValueError(
                f"the environment variable {unknown[0]} is not a setting; available are: "
                f"{', '.join(sorted(known))}"
            )
        return values

    @model_validator(mode="after")
    def _certificate_and_key(self) -> Self:
        if (self.tls_cert is None) != (self.tls_key is None):
            raise ValueError("--tls-cert and --tls-key must be given together or not at all")
        return self

    @property
    def tls(self) -> bool:
        """Return true if the server speaks https."""
        return self.tls_cert is not None

    @property
    def database_location(self) -> str | Path:
        """Return the argument with which to open ``Storage``."""
        return self.database if self.database is not None else self.data / DATABASE_FILE

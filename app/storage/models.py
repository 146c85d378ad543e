"""Database tables. A change needs a migration in ``migrations/versions``; a test compares them."""

from __future__ import annotations

from typing import Any

from sqlalchemy import JSON, BigInteger, Float, ForeignKey, Index, MetaData, String, Text
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship

from app.contract.values import JsonObject

_ISO_TIME = String(32)
_ID = String(64)


class Base(DeclarativeBase):
    # Later migrations can alter named constraints on every database.
    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "fk": "fk_%(table_name)s_%(column_0_N_name)s_%(referred_table_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    type_annotation_map = {JsonObject: JSON, dict[str, str]: JSON}  # noqa: RUF012


class Calibration(Base):
    __tablename__ = "calibrations"

    id: Mapped[str] = mapped_column(_ID, primary_key=True)
    name: Mapped[str] = mapped_column(String(200))
    text: Mapped[str] = mapped_column(Text)
    created_at: Mapped[str] = mapped_column(_ISO_TIME)
    info: Mapped[JsonObject]
    listed: Mapped[bool]


class Truth(Base):
    __tablename__ = "truths"

    id: Mapped[str] = mapped_column(_ID, primary_key=True)
    name: Mapped[str] = mapped_column(String(200))
    format: Mapped[str] = mapped_column(String(40))
    file: Mapped[str] = mapped_column(String(200))
    info: Mapped[JsonObject]
    created_at: Mapped[str] = mapped_column(_ISO_TIME)
    listed: Mapped[bool]


class RunTag(Base):
    __tablename__ = "run_tags"

    run_id: Mapped[str] = mapped_column(ForeignKey("runs.id", ondelete="CASCADE"), primary_key=True)
    tag: Mapped[str] = mapped_column(String(200), primary_key=True, index=True)


class Run(Base):
    __tablename__ = "runs"

    id: Mapped[str] = mapped_column(_ID, primary_key=True)
    name: Mapped[str] = mapped_column(String(200))
    state: Mapped[str] = mapped_column(String(20), index=True)
    source: Mapped[str] = mapped_column(Text)
    calibration_id: Mapped[str | None] = mapped_column(ForeignKey(Calibration.id), index=True)
    preset: Mapped[str | None] = mapped_column(String(200))
    parameters: Mapped[JsonObject]
    started_at: Mapped[str] = mapped_column(_ISO_TIME, index=True)
    updated_at: Mapped[str] = mapped_column(_ISO_TIME)
    ended_at: Mapped[str | None] = mapped_column(_ISO_TIME)
    frames: Mapped[int]
    segments: Mapped[int]
    versions: Mapped[dict[str, str]]
    reason: Mapped[str | None] = mapped_column(Text)
    notes: Mapped[str] = mapped_column(Text)
    # Name, notes and tags as returned by ``searching.folded``, so that every database finds the
    # same.
    searched: Mapped[str] = mapped_column(Text)
    deleted_at: Mapped[str | None] = mapped_column(_ISO_TIME, index=True)
    rig: Mapped[str | None] = mapped_column(Text)
    record: Mapped[str | None] = mapped_column(String(20))
    recording_bytes: Mapped[int | None] = mapped_column(BigInteger)
    alignment: Mapped[JsonObject | None] = mapped_column(JSON(none_as_null=True))
    truth_id: Mapped[str | None] = mapped_column(ForeignKey(Truth.id), index=True)
    rerun_of: Mapped[str | None] = mapped_column(_ID)
    begin_s: Mapped[float | None] = mapped_column(Float(53))
    duration_s: Mapped[float | None] = mapped_column(Float(53))

    tags: Mapped[list[RunTag]] = relationship(
        lazy="selectin", cascade="all, delete-orphan", passive_deletes=True
    )


class Speed(Base):
    __tablename__ = "speeds"
    # Rows of a run are returned in the order of writing: truth may be measured before its frame.
    __table_args__ = (Index(None, "run_id", "id"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    run_id: Mapped[str] = mapped_column(ForeignKey(Run.id, ondelete="CASCADE"))
    time: Mapped[float] = mapped_column(Float(53))
    role: Mapped[str] = mapped_column(String(20))
    source: Mapped[str] = mapped_column(String(20))
    track_id: Mapped[int | None]
    speed: Mapped[float | None] = mapped_column(Float(53))
    std: Mapped[float | None] = mapped_column(Float(53))
    segment: Mapped[int]
    body: Mapped[str | None] = mapped_column(String(200))


class Incident(Base):
    __tablename__ = "incidents"
    __table_args__ = (Index(None, "run_id", "id"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    run_id: Mapped[str] = mapped_column(ForeignKey(Run.id, ondelete="CASCADE"))
    at: Mapped[str] = mapped_column(_ISO_TIME)
    role: Mapped[str | None] = mapped_column(String(20))
    kind: Mapped[str] = mapped_column(String(20))
    sentence: Mapped[str] = mapped_column(Text)
    speed_mps: Mapped[float | None] = mapped_column(Float(53))


class IncidentStop(Base):
    __tablename__ = "incident_stops"

    incident_id: Mapped[int] = mapped_column(
        ForeignKey(Incident.id, ondelete="CASCADE"), primary_key=True
    )
    role: Mapped[str] = mapped_column(String(20), primary_key=True)
    zero_ms: Mapped[float | None] = mapped_column(Float(53))
    stood_ms: Mapped[float | None] = mapped_column(Float(53))
    distance_m: Mapped[float | None] = mapped_column(Float(53))
    speed_mps: Mapped[float | None] = mapped_column(Float(53))
    separation_m: Mapped[float | None] = mapped_column(Float(53))


class Revision(Base):
    __tablename__ = "parameter_revisions"

    id: Mapped[int] = mapped_column(primary_key=True)
    run_id: Mapped[str | None] = mapped_column(ForeignKey(Run.id, ondelete="CASCADE"), index=True)
    frame: Mapped[int | None]
    revision: Mapped[int]
    difference: Mapped[JsonObject]
    created_at: Mapped[str] = mapped_column(_ISO_TIME)


class Preset(Base):
    __tablename__ = "presets"

    name: Mapped[str] = mapped_column(String(200), primary_key=True)
    values: Mapped[JsonObject]
    help: Mapped[str] = mapped_column(Text)
    created_at: Mapped[str] = mapped_column(_ISO_TIME)


class Setting(Base):
    __tablename__ = "settings"

    key: Mapped[str] = mapped_column(String(200), primary_key=True)
    value: Mapped[Any] = mapped_column(JSON)

"""Export of a whole run as one zip: tables, video, point cloud, calibration, and a README."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import msgspec

from observer.errors import DynamicObserverError
from observer.exporting.clouds import Frame, cloud_at, write_ply
from observer.exporting.errors import ExportError
from observer.exporting.run_video import write_run_video
from observer.exporting.table_files import check_parquet, write_csv, write_parquet
from observer.exporting.tables import TABLES, Table
from observer.recording.reader import Recording

TableFormat = Literal["csv", "parquet"]


@dataclass
class _Contents:
    """Contents of the zip, for its README."""

    files: list[tuple[str, str]] = field(default_factory=list)
    tables: list[tuple[Table, int]] = field(default_factory=list)
    absent: list[str] = field(default_factory=list)


def write_archive(
    recording: Recording,
    path: Path,
    *,
    tables: TableFormat = "csv",
    cloud_position: int = 0,
    cloud_frame: Frame = "world",
    progress: Callable[[int, int | None], None] | None = None,
) -> None:
    """Write the zip; what the recording does not hold is named in its README instead.

    Args:
        tables: their format. cloud_position: frame of the point cloud, from 0.
        progress: called with frames of the video done and their number.

    Raises:
        ExportError: nothing can be written, or pyarrow is not installed and Parquet asked for.
    """
    if tables == "parquet":
        check_parquet()
    contents = _Contents()
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for table in TABLES.values():
            _add_table(archive, recording, table, tables, contents)
        _add_video(archive, recording, path, contents, progress)
        _add_cloud(archive, recording, cloud_position, cloud_frame, contents)
        facts = msgspec.json.format(msgspec.json.encode(recording.facts), indent=2)
        archive.writestr("run.json", facts)
        contents.files.append(("run.json", "source, cameras, versions and clocks of the run"))
        archive.writestr("calibration.yaml", recording.facts.calibration_yaml)
        contents.files.append(("calibration.yaml", "as the run was observed with, OpenCV's format"))
        if recording.facts.rig_yaml is not None:
            archive.writestr("rig.yaml", recording.facts.rig_yaml)
            contents.files.append(("rig.yaml", "how the camera stood on its robot"))
        with archive.open("observations.jsonl", "w") as lines:
            for line in recording.lines():
                lines.write(json.dumps(line, allow_nan=False).encode() + b"\n")
        contents.files.append(("observations.jsonl", "one JSON line for each frame, as observe's"))
        archive.writestr("README.md", _readme(recording, contents))


def _add_table(
    archive: zipfile.ZipFile,
    recording: Recording,
    table: Table,
    format_: TableFormat,
    contents: _Contents,
) -> None:
    if next(table.rows(recording), None) is None:
        contents.absent.append(f"{table.name}: nothing of it was recorded")
        return
    name = f"{table.name}.{format_}"
    if format_ == "parquet":
        packed = io.BytesIO()
        count = write_parquet(table, recording, packed)
        archive.writestr(name, packed.getvalue())
    else:
        with (
            archive.open(name, "w", force_zip64=True) as raw,
            io.TextIOWrapper(raw, encoding="utf-8", newline="") as file,
        ):
            count = write_csv(table, recording, file)
    contents.tables.append((table, count))


def _add_video(
    archive: zipfile.ZipFile,
    recording: Recording,
    beside: Path,
    contents: _Contents,
    progress: Callable[[int, int | None], None] | None,
) -> None:
    video = beside.with_name(f"{beside.name}.mp4")
    try:
        made = write_run_video(recording, video, progress)
        # It is packed already.
        archive.write(video, "overlay.mp4", compress_type=zipfile.ZIP_STORED)
        contents.files.append(("overlay.mp4", f"what was found, over the left image; {made.codec}"))
    except ExportError as error:
        contents.absent.append(f"overlay.mp4: {error}")
    finally:
        video.unlink(missing_ok=True)


def _add_cloud(
    archive: zipfile.ZipFile,
    recording: Recording,
    position: int,
    frame: Frame,
    contents: _Contents,
) -> None:
    try:
        cloud = cloud_at(recording, position, frame)
    except DynamicObserverError as error:
        contents.absent.append(f"cloud.ply: {error}")
        return
    packed = io.BytesIO()
    write_ply(cloud, packed)
    archive.writestr("cloud.ply", packed.getvalue())
    told = f"{len(cloud.points)} points of frame {cloud.index}, {cloud.frame} frame, {cloud.source}"
    contents.files.append(("cloud.ply", told))


def _readme(recording: Recording, contents: _Contents) -> str:
    facts = recording.facts
    lines = [
        f"# {facts.name}",
        "",
        f"Run {facts.id} of {facts.source}, {len(recording.frames)} frames"
        f"{', unfinished' if recording.unfinished else ''}.",
        "",
        "SI units, named at the end of each column: _m, _mps (m/s), _s, _rad, _radps (rad/s), _px, "
        "_m2, _m2ps2. time_s is the source's clock, received_s the host's monotonic one. The world "
        "is the camera frame at a segment's first pose: x right, y down, z forward. An empty cell "
        "is what is not known.",
        "",
        *(f"- {name}: {help_}" for name, help_ in contents.files),
    ]
    if contents.absent:
        lines += ["", "Not here:", "", *(f"- {sentence}" for sentence in contents.absent)]
    for table, count in contents.tables:
        lines += ["", f"## {table.name}", "", f"{table.help}; {count} rows.", ""]
        lines += [f"- {column.name} ({column.kind}): {column.help}" for column in table.columns]
    return "\n".join(lines) + "\n"

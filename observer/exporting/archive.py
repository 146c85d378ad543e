"""Export of a whole run as one zip, with a README."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import msgspec

from observer.errors import DynamicObserverError
from observer.exporting.choices import CloudFrame, TableFormat
from observer.exporting.clouds import cloud_at, write_ply
from observer.exporting.errors import ExportError
from observer.exporting.run_video import write_run_video
from observer.exporting.table_files import check_parquet, write_csv, write_parquet
from observer.exporting.tables import TABLES, Table
from observer.exporting.trajectories import write_tum
from observer.recording.reader import Recording


def write_archive(
    recording: Recording,
    path: Path,
    *,
    tables: TableFormat = "csv",
    cloud_position: int = 0,
    cloud_frame: CloudFrame = "world",
    progress: Callable[[int, int | None], None] | None = None,
) -> None:
    """Write the zip; its README lists what the recording does not contain.

    Args:
        tables: their format. cloud_position: frame of the point cloud, from 0.
        progress: called with the number of video frames done and their total.

    Raises:
        ExportError: nothing can be written, or Parquet is requested but pyarrow not installed.
    """
    if tables == "parquet":
        check_parquet()
    facts = recording.facts
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        archive = _Archive(file, recording)
        for table in TABLES.values():
            archive.add_table(table, tables)
        archive.add_video(path.with_name(f"{path.name}.mp4"), progress)
        archive.add_cloud(cloud_position, cloud_frame)
        archive.add_trajectory()
        run = msgspec.json.format(msgspec.json.encode(facts), indent=2)
        archive.add("run.json", run, "source, cameras, versions and clocks of the run")
        description = "calibration used in the run, OpenCV format"
        archive.add("calibration.yaml", facts.calibration_yaml, description)
        if facts.rig_yaml is not None:
            archive.add("rig.yaml", facts.rig_yaml, "camera mount on the robot")
        archive.add_lines()
        file.writestr("README.md", archive.readme())


class _Archive:
    """The zip, and the contents of its README."""

    def __init__(self, file: zipfile.ZipFile, recording: Recording) -> None:
        self._file = file
        self._recording = recording
        self._descriptions: list[tuple[str, str]] = []
        self._tables: list[tuple[Table, int]] = []
        self._absent: list[str] = []

    def add(self, name: str, content: str | bytes, description: str) -> None:
        self._file.writestr(name, content)
        self._descriptions.append((name, description))

    def add_table(self, table: Table, format_: TableFormat) -> None:
        recording = self._recording
        if next(table.rows(recording), None) is None:
            self._absent.append(f"{table.name}: none were recorded")
            return
        name = f"{table.name}.{format_}"
        if format_ == "parquet":
            packed = io.BytesIO()
            count = write_parquet(table, recording, packed)
            self._file.writestr(name, packed.getvalue())
        else:
            with (
                self._file.open(name, "w", force_zip64=True) as raw,
                io.TextIOWrapper(raw, encoding="utf-8", newline="") as file,
            ):
                count = write_csv(table, recording, file)
        self._tables.append((table, count))

    def add_video(self, video: Path, progress: Callable[[int, int | None], None] | None) -> None:
        try:
            codec = write_run_video(self._recording, video, progress).codec
            # It is already compressed.
            self._file.write(video, "overlay.mp4", compress_type=zipfile.ZIP_STORED)
            self._descriptions.append(
                ("overlay.mp4", f"overlay of the detected obstacles on the left image; {codec}")
            )
        except ExportError as error:
            self._absent.append(f"overlay.mp4: {error}")
        finally:
            video.unlink(missing_ok=True)

    def add_cloud(self, position: int, frame: CloudFrame) -> None:
        try:
            cloud = cloud_at(self._recording, position, frame)
        except DynamicObserverError as error:
            self._absent.append(f"cloud.ply: {error}")
            return
        packed = io.BytesIO()
        write_ply(cloud, packed)
        self.add(
            "cloud.ply",
            packed.getvalue(),
            f"{len(cloud.points)} points of frame {cloud.index}, {cloud.frame} frame, "
            f"{cloud.source}",
        )

    def add_trajectory(self) -> None:
        text = io.StringIO()
        try:
            written = write_tum(self._recording, text)
        except ExportError as error:
            self._absent.append(f"camera.tum: {error}")
            return
        self.add(
            "camera.tum",
            text.getvalue(),
            f"trajectory of the left camera in the TUM format, {written.poses} poses",
        )

    def add_lines(self) -> None:
        with self._file.open("observations.jsonl", "w", force_zip64=True) as lines:
            for line in self._recording.lines():
                lines.write(json.dumps(line, allow_nan=False).encode() + b"\n")
        self._descriptions.append(
            ("observations.jsonl", "one JSON line per frame, as written by observe")
        )

    def readme(self) -> str:
        facts = self._recording.facts
        lines = [
            f"# {facts.name}",
            "",
            f"Run {facts.id} of {facts.source}, {len(self._recording.frames)} frames"
            f"{', unfinished' if self._recording.unfinished else ''}.",
            "",
            "SI units, named at the end of each column: _m, _mps (m/s), _s, _rad, _radps (rad/s), "
            "_px, _m2, _m2ps2. time_s is the source's clock, received_s the host's monotonic one. "
            "The world is the camera frame at a segment's first pose: x right, y down, z forward. "
            "An empty cell means unknown. Uncertainties (_std, _cov) are standard deviations and "
            "covariances, not 95 % intervals.",
            "",
            *(f"- {name}: {help_}" for name, help_ in self._descriptions),
        ]
        if self._absent:
            lines += ["", "Not included:", "", *(f"- {sentence}" for sentence in self._absent)]
        for table, count in self._tables:
            lines += ["", f"## {table.name}", "", f"{table.help}; {count} rows.", ""]
            lines += [f"- {column.name} ({column.kind}): {column.help}" for column in table.columns]
        return "\n".join(lines) + "\n"

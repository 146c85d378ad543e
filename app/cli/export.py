"""``dynamic-observer export``: export a run to files for other tools."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.progress import ProgressCallback, progress_bar
from app.cli.run_choice import RunArgument
from app.cli.storage_options import DataOption, chosen_settings
from observer.errors import InputError
from observer.exporting.choices import BagStorage, CloudFrame, TableFormat

if TYPE_CHECKING:
    from observer.recording.reader import Recording

_ENDINGS = (".csv", ".parquet", ".tum", ".mp4", ".ply", ".zip")


def export(
    run: RunArgument,
    output: Annotated[
        Path,
        typer.Option(
            help="Output file; the extension decides: .csv or .parquet a table, .tum the camera "
            "trajectory, .mp4 the left image with overlays, .ply the point cloud of a frame, "
            ".zip everything with a README of the columns. With --ros2 a folder."
        ),
    ],
    table: Annotated[
        str,
        typer.Option(
            help="Table for .csv and .parquet: obstacles, frames, odometry, robots, goal, "
            "map, parameters, or ground truth as truth or matched_truth."
        ),
    ] = "obstacles",
    track: Annotated[
        int | None,
        typer.Option(help="For .tum: the trajectory of this obstacle instead of the camera's."),
    ] = None,
    tables: Annotated[
        TableFormat, typer.Option(help="Format of the tables in a .zip file.")
    ] = "csv",
    frame: Annotated[
        int, typer.Option(min=0, help="For .ply and .zip: index of the recorded frame, from 0.")
    ] = 0,
    cloud_frame: Annotated[
        CloudFrame, typer.Option(help="Coordinate frame of the points of the cloud.")
    ] = "world",
    ros2: Annotated[bool, typer.Option("--ros2", help="Write a bag for ros2 bag play.")] = False,
    storage: Annotated[BagStorage, typer.Option(help="For the messages of the bag.")] = "sqlite3",
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace an existing output.")
    ] = False,
    data: DataOption = None,
) -> None:
    """Export a run for other tools.

    Tracks, ground truth, video, point cloud, or a ROS 2 bag.
    """
    from observer.exporting.output import whole_output
    from observer.recording.reader import Recording
    from observer.recording.run_folder import find_recording

    ending = output.suffix.lower()
    if not ros2 and ending not in _ENDINGS:
        raise InputError(
            f"unknown extension in {output.name}; use {', '.join(_ENDINGS)}, or --ros2"
        )
    path = find_recording(run, chosen_settings(data=data).data)
    with (
        whole_output(output, overwrite=overwrite) as part,
        Recording(path) as recording,
        progress_bar(f"exporting {path.name}") as progress,
    ):
        if ros2:
            summary = _bag(recording, part, storage, progress)
        elif ending in (".csv", ".parquet"):
            summary = _table(recording, part, table, ending)
        elif ending == ".tum":
            summary = _trajectory(recording, part, track)
        elif ending == ".mp4":
            summary = _video(recording, part, progress)
        elif ending == ".ply":
            summary = _cloud(recording, part, frame, cloud_frame)
        else:
            summary = _archive(recording, part, tables, frame, cloud_frame, progress)
    unfinished = " (from an incomplete recording)" if recording.unfinished else ""
    typer.echo(f"{output}: {summary}{unfinished}", err=True)


def _bag(recording: Recording, part: Path, storage: BagStorage, progress: ProgressCallback) -> str:
    from observer.exporting.ros2 import write_ros2_bag

    counts = write_ros2_bag(recording, part, storage=storage, progress=progress)
    return f"{sum(counts.values())} messages of {len(counts)} topics for ros2 bag play"


def _table(recording: Recording, part: Path, name: str, ending: str) -> str:
    from observer.exporting.table_files import check_parquet, write_csv, write_parquet
    from observer.exporting.tables import find_table

    table = find_table(name)
    if ending == ".csv":
        with part.open("w", newline="", encoding="utf-8") as text:
            count = write_csv(table, recording, text)
    else:
        check_parquet()
        with part.open("wb") as packed:
            count = write_parquet(table, recording, packed)
    return f"{count} rows of {len(table.columns)} columns, {table.help}"


def _trajectory(recording: Recording, part: Path, track: int | None) -> str:
    from observer.exporting.trajectories import write_tum

    with part.open("w", encoding="utf-8") as text:
        written = write_tum(recording, text, track)
    others = f"; {written.others} of other segments are not included" if written.others else ""
    return f"{written.poses} poses in the world of segment {written.segment}{others}"


def _video(recording: Recording, part: Path, progress: ProgressCallback) -> str:
    from observer.exporting.run_video import write_run_video

    video = write_run_video(recording, part, progress)
    return f"{video.pictures} pictures as {video.codec}"


def _cloud(recording: Recording, part: Path, frame: int, cloud_frame: CloudFrame) -> str:
    from observer.exporting.clouds import cloud_at, write_ply

    cloud = cloud_at(recording, frame, cloud_frame)
    with part.open("wb") as file:
        write_ply(cloud, file)
    return f"{len(cloud.points)} points in the {cloud.frame} frame, {cloud.source}"


def _archive(
    recording: Recording,
    part: Path,
    tables: TableFormat,
    frame: int,
    cloud_frame: CloudFrame,
    progress: ProgressCallback,
) -> str:
    from observer.exporting.archive import write_archive

    write_archive(
        recording,
        part,
        tables=tables,
        cloud_position=frame,
        cloud_frame=cloud_frame,
        progress=progress,
    )
    return f"all of {len(recording.frames)} frames, columns explained in its README.md"

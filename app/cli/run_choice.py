"""The run that a command is about, with the truth that was laid over it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.storage_options import storage_settings
from observer.recording.run_folder import find_recording

if TYPE_CHECKING:
    from app.reports.comparison import Comparison

RunArgument = Annotated[
    str,
    typer.Argument(help="Id of a run or its beginning, its folder, or a recording's file."),
]
ComparedOption = Annotated[
    Path | None,
    typer.Option(help="Truth laid over the run, as align writes it; else what is kept with it."),
]


def chosen_run(
    run: str, compared: Path | None, data: Path | None, database: str | None
) -> tuple[Path, Comparison | None]:
    """The recording, and what it is compared with beside its own truth.

    Args:
        run: an id or its beginning, a run's folder, or a recording's file.
        compared: a file that ``align`` wrote; None for what is kept with the run.

    Raises:
        SourceError: there is no such recording. TruthError, InputError: ``compared`` is no use.
        StorageError: the database cannot be read.
    """
    from app.reports.comparison import Comparison

    if compared is not None or Path(run).exists():
        # A file or a folder may be of anywhere, so no database is asked about it.
        path = find_recording(run, storage_settings(data, database).data.expanduser().absolute())
        return path, None if compared is None else Comparison.read(compared)
    settings = storage_settings(data, database)
    path = find_recording(run, settings.data.expanduser().absolute())
    from app.storage import Storage
    from app.storage.comparison import kept_comparison

    with Storage(settings.database_location, folder=settings.data) as storage:
        record = storage.get_run(path.parent.name)
        if record is None or record.alignment is None:
            return path, None
        return path, Comparison.of_dict(kept_comparison(record, storage))

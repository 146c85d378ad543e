"""The run that a command works on, with the ground truth that is aligned with it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.storage_options import chosen_settings
from observer.recording.run_folder import SeveralRuns, find_recording

if TYPE_CHECKING:
    from app.reports.comparison import Comparison
    from app.settings import Settings

RunArgument = Annotated[
    str,
    typer.Argument(help="Id of a run (or its first characters), its folder, or a recording file."),
]
ComparedOption = Annotated[
    Path | None,
    typer.Option(
        help="Ground truth for the run, as written by align. [default: the one stored with it]"
    ),
]


def chosen_run(
    run: str, compared: Path | None, data: Path | None, database: str | None
) -> tuple[Path, Comparison | None]:
    """Return the recording, and what it is compared with instead of its own truth.

    Args:
        run: an id or its beginning, a run's folder, or a recording file.
        compared: a file written by ``align``; None for the truth stored with the run.

    Raises:
        SourceError: there is no such recording. TruthError, InputError: ``compared`` is unusable.
        StorageError: the database cannot be read.
    """
    settings = chosen_settings(data=data, database=database)
    try:
        path = find_recording(run, settings.data)
    except SeveralRuns as error:
        raise _with_deleted(error, settings) from None
    # Imported late, so that a missing run is reported at once.
    from app.reports.comparison import Comparison

    if compared is not None:
        return path, Comparison.read(compared)
    if Path(run).exists():
        # A file or folder may come from anywhere, so no database is queried about it.
        return path, None
    from app.storage import Storage
    from app.storage.comparison import kept_comparison

    with Storage(settings.database_location, folder=settings.data) as storage:
        record = storage.get_run(path.parent.name)
        if record is None or record.alignment is None:
            return path, None
        return path, Comparison.of_dict(kept_comparison(record, storage))


def _with_deleted(error: SeveralRuns, settings: Settings) -> SeveralRuns:
    """Return the error with the deleted runs marked as such."""
    from app.storage import Storage

    with Storage(settings.database_location, folder=settings.data) as storage:
        records = [storage.get_run(name) for name in error.names]
    deleted = [each.id for each in records if each is not None and each.deleted_at is not None]
    return SeveralRuns(error.beginning, error.names, deleted)

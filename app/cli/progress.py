"""Progress of long work on stderr; silent without a terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

# Called with (done, total); total is None if unknown.
ProgressCallback = Callable[[int, int | None], None]


def drawn_progress(*columns: ProgressColumn) -> Progress:
    """Return a progress display on stderr that is drawn only on a terminal and removed at its end.

    Args:
        columns: shown between the bar and the remaining time.
    """
    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        *columns,
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
        transient=True,
    )


@contextmanager
def progress_bar(title: str) -> Iterator[ProgressCallback]:
    """Show a bar on stderr while the block runs; drawn only on a terminal."""
    with drawn_progress(MofNCompleteColumn()) as progress:
        task = progress.add_task(title, total=None)

        def advance(done: int, total: int | None) -> None:
            progress.update(task, completed=done, total=total)

        yield advance

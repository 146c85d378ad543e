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
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        *columns,
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
        transient=True,
        # Data on stdout stays where it was redirected, whatever is drawn on stderr.
        redirect_stdout=False,
    )


class ProgressBar:
    """Bar on display; call it with (done, total), total None if unknown."""

    def __init__(self, progress: Progress, title: str) -> None:
        self._progress = progress
        self._task = progress.add_task(title, total=None)

    def __call__(self, done: int, total: int | None) -> None:
        self._progress.update(self._task, completed=done, total=total)

    def begin(self, title: str) -> None:
        """Show this title from now on."""
        self._progress.update(self._task, description=title)

    def end(self) -> None:
        """Remove the bar before the block ends: what follows is written to the terminal."""
        self._progress.stop()


@contextmanager
def progress_bar(title: str) -> Iterator[ProgressBar]:
    """Show a bar on stderr while the block runs; drawn only on a terminal.

    It is drawn at once: start it before imports that take a second.
    """
    with drawn_progress(MofNCompleteColumn()) as progress:
        bar = ProgressBar(progress, title)
        progress.refresh()
        yield bar

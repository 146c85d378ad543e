"""Progress of long work, on stderr, and silent where nobody watches."""

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

# Called with (done, total); total is None where it is not known.
ProgressCallback = Callable[[int, int | None], None]


def drawn_progress(*columns: ProgressColumn) -> Progress:
    """Progress on stderr, gone behind its end, and only drawn on a terminal.

    Args:
        columns: between the bar and the time that remains.
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
    """A bar on stderr while the block runs; only drawn on a terminal."""
    with drawn_progress(MofNCompleteColumn()) as progress:
        task = progress.add_task(title, total=None)

        def advance(done: int, total: int | None) -> None:
            progress.update(task, completed=done, total=total)

        yield advance

"""Search for a run's recording by file, folder or id."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from glob import escape
from pathlib import Path

from observer.errors import SourceError

RUNS = "runs"
RECORDING = "recording.mcap"
_SHOWN = 5


class SeveralRuns(SourceError):
    """The beginning of an id is ambiguous.

    Attributes:
        beginning: as it was given. names: the ids that begin so.
    """

    def __init__(self, beginning: str, names: Sequence[str], deleted: Collection[str] = ()) -> None:
        """Name the first ids.

        Args:
            deleted: those of them that were deleted, and can still be recovered.
        """
        self.beginning = beginning
        self.names = tuple(names)
        shown = ", ".join(
            f"{name} (deleted)" if name in deleted else name for name in self.names[:_SHOWN]
        )
        super().__init__(f"{beginning} matches several runs ({shown}); give more of the id")


def find_recording(run: Path | str, data: Path | None = None) -> Path:
    """Return the path of a recording.

    Args:
        run: a recording file, a run's folder, or the id of a run or its beginning.
        data: the data folder in which runs are searched by id; None if there is none.

    Raises:
        SourceError: there is none. SeveralRuns: the beginning of an id is ambiguous.
    """
    path = Path(run)
    if path.is_file():
        return path
    if (path / RECORDING).is_file():
        return path / RECORDING
    if path.exists():
        raise SourceError(
            f"{run} contains no {RECORDING}; give the folder of a run or a recording file"
        )
    name = str(run)
    if data is None or path.suffix or path.name != name:
        raise SourceError(
            f"there is no recording {run}; give the file, the folder or the id of a run"
        )
    runs = data / RUNS
    found = [runs / name] if (runs / name).is_dir() else sorted(runs.glob(f"{escape(name)}*"))
    if len(found) > 1:
        raise SeveralRuns(name, [each.name for each in found])
    if not found:
        raise SourceError(
            f"there is no run {name} in {data}; give its id, its folder or a recording file"
        )
    recording = found[0] / RECORDING
    if not recording.is_file():
        raise SourceError(f"the run {found[0].name} has no recording to read")
    return recording

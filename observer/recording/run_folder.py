"""Search for a run's recording by file, folder or id."""

from __future__ import annotations

from glob import escape
from pathlib import Path

from observer.errors import SourceError

RUNS = "runs"
RECORDING = "recording.mcap"


def find_recording(run: Path | str, data: Path | None = None) -> Path:
    """Return the path of a recording.

    Args:
        run: a recording file, a run's folder, or the id of a run or its beginning.
        data: the data folder in which runs are searched by id; None if there is none.

    Raises:
        SourceError: there is none, or the beginning of an id is ambiguous.
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
        names = ", ".join(each.name for each in found[:5])
        raise SourceError(f"{name} matches several runs ({names}); give more of the id")
    if not found:
        raise SourceError(
            f"there is no run {name} in {data}; give its id, its folder or a recording file"
        )
    recording = found[0] / RECORDING
    if not recording.is_file():
        raise SourceError(f"the run {found[0].name} has no recording to read")
    return recording

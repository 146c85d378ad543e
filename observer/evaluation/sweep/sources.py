"""Sources of a sweep: finite, with ground truth, and identified by their content."""

from __future__ import annotations

import hashlib
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from observer.errors import InputError
from observer.evaluation.sources import BenchmarkSource, described
from observer.opening import (
    exclusive_world,
    live_devices,
    open_source,
    shown_spec,
    simulated_world,
    source_kind,
)
from observer.simulation.scenarios import load_scenario

_VIDEO = "video:"
_BLOCK = 1 << 20


@dataclass(frozen=True)
class SweepSource:
    """Source of a sweep.

    Attributes:
        name: as given, for people. benchmark: its spec has absolute paths, so that it can be
            found from any working directory.
        frames: highest number that is observed.
        digest: of its content: the bytes of a file; the names, sizes and modification times of a
            folder's files; a scenario with everything that it is based on, and its seed.
    """

    name: str
    benchmark: BenchmarkSource
    frames: int
    digest: str

    @property
    def extent(self) -> str:
        """Return how much of it there is, in words."""
        return f"{self.frames} frames"


def sweep_source(spec: str, frames: int | None) -> SweepSource:
    """Check and describe a source before it is run.

    Args:
        frames: most frames to observe; None for all.

    Raises:
        InputError: there is no such source, or it is live, endless, or without calibration or
            ground truth.
    """
    shown = shown_spec(spec)
    if live_devices(spec) or exclusive_world(spec) is not None:
        raise InputError(
            f"{shown} is live and therefore not repeatable; record a run and sweep over the "
            "recording"
        )
    spec = _with_whole_paths(spec)
    source = described(spec)
    if source.frames is None and frames is None:
        raise InputError(
            f"{shown} never ends; limit the number of frames, for example --frames 300"
        )
    if source.declares is None:
        _check(spec, shown)
    planned = source.planned(frames) if frames is not None else source.frames
    assert planned is not None
    return SweepSource(shown, replace(source, frames=planned), planned, _digest(spec))


def _check(spec: str, shown: str) -> None:
    opened = open_source(spec)
    with closing(opened.source):
        if opened.source.calibration is None:
            raise InputError(f"{shown} has no calibration, so it cannot be used in a sweep")
        if opened.truth is None:
            raise InputError(
                f"{shown} has no ground truth to evaluate against; give a recording with ground "
                "truth, or a folder with truth.csv"
            )


def _with_whole_paths(spec: str) -> str:
    if spec.startswith(_VIDEO):
        parts = spec.removeprefix(_VIDEO).split(",")
        return _VIDEO + ",".join(_whole(part) for part in parts)
    return _whole(spec)


def _whole(text: str) -> str:
    path = Path(text)
    return str(path.resolve()) if path.exists() else text


def _digest(spec: str) -> str:
    digest = hashlib.blake2b(digest_size=16)
    if source_kind(spec) == "simulated":
        name, seed = simulated_world(spec)
        digest.update(f"{load_scenario(name).model_dump_json()}\n{seed}".encode())
        return digest.hexdigest()
    for part in spec.removeprefix(_VIDEO).split(",") if spec.startswith(_VIDEO) else [spec]:
        path = Path(part)
        if path.is_file():
            with path.open("rb") as file:
                while block := file.read(_BLOCK):
                    digest.update(block)
        elif path.is_dir():
            for each in sorted(p for p in path.rglob("*") if p.is_file()):
                about = each.stat()
                line = f"{each.relative_to(path)} {about.st_size} {about.st_mtime_ns}\n"
                digest.update(line.encode())
        else:
            digest.update(part.encode())
    return digest.hexdigest()

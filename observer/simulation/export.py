"""Exports a scenario as a stereo folder: images, times, calibration and ground truth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2

from observer.calibration.formats.opencv_file import calibration_text
from observer.errors import InputError
from observer.simulation.scenarios import load_scenario
from observer.simulation.source import SimulatedSource
from observer.simulation.truth import SimulatedTruth
from observer.simulation.world import World
from observer.truth.csv_file import write_truth_csv
from observer.truth.sampled import TruthSample
from observer.types import Image

# PNG is lossless; on noisy images low compression levels give files as small as high ones.
_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1)


def export_stereo_folder(
    scenario_name: str,
    seed: int,
    output: Path,
    progress: Callable[[int, int], None] | None = None,
    frames: int | None = None,
) -> int:
    """Write every frame of a scenario; equal scenario and seed write equal files.

    Args:
        scenario_name: a built-in scenario or the path of a scenario file.
        output: a folder that does not exist yet or is empty. It receives ``left/`` and
            ``right/`` (PNG, equal names), ``times.txt`` (one time per line, seconds),
            ``calibration.yaml`` (as the scenario hands it out; absent if it hands out none) and
            ``truth.csv``.
        progress: called after every frame with the number written and the total.
        frames: number of frames to write; None writes all.

    Returns:
        The number of frames.

    Raises:
        ScenarioError: there is no such scenario.
        InputError: the folder is not empty or cannot be written.
    """
    world = World(load_scenario(scenario_name), seed)
    try:
        return _export(world, output, progress, frames)
    except OSError as error:
        raise InputError(f"{output} cannot be written: {error.strerror or error}") from None


def _export(
    world: World,
    output: Path,
    progress: Callable[[int, int], None] | None,
    frames: int | None,
) -> int:
    if output.exists() and not output.is_dir():
        raise InputError(f"{output} is a file; name a new or empty folder")
    if output.is_dir() and next(output.iterdir(), None) is not None:
        raise InputError(f"the folder {output} is not empty; name a new or empty one")
    for side in ("left", "right"):
        (output / side).mkdir(parents=True, exist_ok=True)
    source, truth = SimulatedSource(world), SimulatedTruth(world)
    total = (
        world.scenario.frame_count if frames is None else min(frames, world.scenario.frame_count)
    )
    samples: list[TruthSample] = []
    while len(samples) < total and (frame := source.read()) is not None:
        name = f"{frame.index:06d}.png"
        _write_png(output / "left" / name, frame.left)
        _write_png(output / "right" / name, frame.right)
        pose = truth.camera_pose(frame.time)
        samples.append(TruthSample(frame.index, frame.time, truth.bodies(frame.time), pose))
        if progress is not None:
            progress(frame.index + 1, total)
    times = "".join(f"{sample.time:.9f}\n" for sample in samples)
    (output / "times.txt").write_text(times, encoding="utf-8")
    if source.calibration is not None:
        text = calibration_text(source.calibration)
        (output / "calibration.yaml").write_text(text, encoding="utf-8")
    write_truth_csv(output / "truth.csv", samples)
    return len(samples)


def _write_png(path: Path, image: Image) -> None:
    # Write the file in Python, which reports the cause of an error; cv2.imwrite does not.
    _, encoded = cv2.imencode(".png", image, _PNG)
    path.write_bytes(encoded.tobytes())

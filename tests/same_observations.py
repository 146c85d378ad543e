"""Compare the observer's results before and after a change, to the last digit.

    python tests/same_observations.py record DIR [--frames N] [--seeds 4] [--jobs 2]
    python tests/same_observations.py compare BEFORE AFTER

``record`` observes every benchmark scenario with every seed and every method, and writes a file
of JSON lines for each, without timings. ``compare`` prints the first differing line of each file,
and exits with 1 if there is any. Parameters are given by presets and names known to both sides of
the comparison, so that the script also runs in a checkout of an older revision.
"""

from __future__ import annotations

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

MODELS = {
    "default": ("default", {}),
    "paper": ("paper", {}),
    "homography": ("paper", {"ego_motion.model": "homography", "features.detector": "orb"}),
    "monocular": ("default", {"ego_motion.model": "monocular"}),
}
# Names used by older revisions, for recording these.
OLDER = {"monocular": "one_camera"}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    record = commands.add_parser("record")
    record.add_argument("folder", type=Path)
    record.add_argument("--frames", type=int, default=10**9)
    record.add_argument("--seeds", type=int, default=4)
    record.add_argument("--jobs", type=int, default=2)
    record.add_argument("--models", default=",".join(MODELS))
    compare = commands.add_parser("compare")
    compare.add_argument("before", type=Path)
    compare.add_argument("after", type=Path)
    chosen = parser.parse_args()
    if chosen.command == "compare":
        return compare_folders(chosen.before, chosen.after)
    return record_folder(
        chosen.folder, chosen.frames, chosen.seeds, chosen.jobs, chosen.models.split(",")
    )


def record_folder(folder: Path, frames: int, seeds: int, jobs: int, models: list[str]) -> int:
    from observer.simulation.scenarios import load_scenario, scenario_names

    scored = [name for name in scenario_names() if load_scenario(name).benchmark]
    folder.mkdir(parents=True, exist_ok=True)
    specs = [(name, seed) for seed in range(1, seeds + 1) for name in scored]
    with ProcessPoolExecutor(jobs) as pool:
        work = [pool.submit(record_source, *spec, frames, folder, models) for spec in specs]
        for spec, done in zip(specs, work, strict=True):
            print(*spec, done.result(), "frames", flush=True)
    return 0


def record_source(name: str, seed: int, limit: int, folder: Path, models: list[str]) -> int:
    import cv2

    from observer.errors import ParameterError
    from observer.jsonl import observation_line
    from observer.observer import Observer
    from observer.opening import open_source
    from observer.parameters import preset
    from observer.types import StereoFrame

    cv2.setNumThreads(1)
    source = open_source(f"simulated:{name}?seed={seed}").source
    try:
        observers: dict[str, Observer] = {}
        lines: dict[str, list[str]] = {}
        for model in models:
            base, changes = MODELS[model]
            try:
                parameters = preset(base).changed(changes)
            except ParameterError:
                older = {key: OLDER.get(value, value) for key, value in changes.items()}
                parameters = preset(base).changed(older)
            assert source.calibration is not None
            observers[model] = Observer(source.calibration, parameters, mount=source.info.mount)
            lines[model] = []
        count = 0
        while count < limit and isinstance(frame := source.read(), StereoFrame):
            for model, observer in observers.items():
                line = {**observation_line(observer.observe(frame), tentative=True)}
                del line["timings_ms"]
                lines[model].append(json.dumps(line))
            count += 1
    finally:
        source.close()
    for model, texts in lines.items():
        (folder / f"{name}-{seed}-{model}.jsonl").write_text("\n".join(texts) + "\n")
    return count


def compare_folders(before: Path, after: Path) -> int:
    files = sorted(path.name for path in after.glob("*.jsonl"))
    different = 0
    lines = 0
    for name in files:
        old, new = ((folder / name).read_text().splitlines() for folder in (before, after))
        lines += len(new)
        pairs = enumerate(zip(old[: len(new)], new, strict=True))
        first = next((n for n, (a, b) in pairs if a != b), None)
        if first is not None:
            different += 1
            print(f"{name}: line {first + 1} differs\n  {old[first][:400]}\n  {new[first][:400]}")
    print(f"{len(files)} files, {lines} lines, {different} files differ")
    return 1 if different or not files else 0


if __name__ == "__main__":
    sys.exit(main())

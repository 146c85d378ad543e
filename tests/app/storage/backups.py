"""A data folder with something of everything that is kept, and backups of it."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

from app.contract.robots import StopMeasured
from app.storage import IncidentRecord, SpeedRow, Storage
from app.storage.backup import write_backup
from app.storage.bundle import Manifest

from ..planted_runs import run_folder

TEXT = "%YAML:1.0\n---\nimage_width: 512 # Größe\n"


def speeds(run_id: str, count: int, start: int = 0) -> list[SpeedRow]:
    return [
        SpeedRow(run_id, i / 3, "obstacle", "estimate", i, None if i % 7 == 0 else i / 11, 0.1, 0)
        for i in range(start, start + count)
    ]


def fill(storage: Storage) -> str:
    """Store something of everything that is kept; return the id of its run."""
    data = storage.folder.path
    data.mkdir(exist_ok=True)
    calibration = storage.save_calibration(TEXT, name="lab.yaml", info={"rms": 0.1 + 0.2})
    storage.activate_calibration(calibration.id)
    (data / "take").write_bytes(b"Frame,t\n" * 1000)
    truth = storage.save_truth(data / "take", name="take.csv", format="nexus")
    (data / "take").unlink()
    storage.save_preset("Mine", {"a": None, "b": 1e-17})
    storage.save_preset("before", {})
    storage.save_parameters(3, {"a": 1 / 3}, None)
    run = storage.create_run(
        name="Größe", source="s", parameters={"a": 1 / 3}, versions={"python": "3"},
        calibration_id=calibration.id, truth_id=truth.id, tags=["x", "ä"], notes="n",
        rig="mount: {}\n", record="jpeg",
    )  # fmt: skip
    storage.append_speeds(speeds(run.id, 2100))
    storage.align_run(run.id, {"offset_s": 0.05}, truth_id=truth.id)
    stop = StopMeasured(1.5, None, 0.1, 0.3, None)
    storage.append_incident(IncidentRecord(run.id, "t", None, "guard", "Stop.", None, {"a": stop}))
    storage.record_parameter_revision(run.id, 3, 1, {"a": 2})
    (data / "rig.yaml").write_text("mount: {height_m: 0.5}\n")
    (data / "programmes").mkdir()
    (data / "programmes" / "short.yaml").write_text("name: short\n")
    folder = run_folder(storage, run.id)
    (folder / "recording.mcap").write_bytes(random.Random(1).randbytes(300_000))
    (folder / "truth").mkdir()
    (folder / "truth" / "as uploaded ä.csv").write_text("t\n")
    for place, clip in (("clips", "clip-1.mcap"), ("rings", "ring-1.mcap")):
        (data / place).mkdir()
        (data / place / clip).write_bytes(b"the last half minute")
    (data / "token").write_text("secret")
    return run.id


def contents(storage: Storage, run_id: str) -> dict[str, Any]:
    """Return everything that can be read back of it."""
    data = storage.folder.path
    tops = ("rig.yaml", "programmes", "truths", "runs", "clips", "rings")
    files = [each for top in tops for each in [data / top, *(data / top).rglob("*")]]
    return {
        "run": storage.get_run(run_id),
        "runs": storage.list_runs(),
        "tags": storage.run_tags(),
        "speeds": storage.speeds(run_id),
        "incidents": storage.incidents(run_id),
        "revisions": storage.parameter_revisions(run_id),
        "presets": storage.list_presets(),
        "parameters": storage.load_parameters(),
        "calibrations": storage.list_calibrations(),
        "active": storage.active_calibration(),
        "truths": storage.list_truths(),
        "files": {str(f.relative_to(data)): f.read_bytes() for f in files if f.is_file()},
    }


def back_up(storage: Storage, location: str | Path, target: Path, **given: Any) -> Manifest:
    given = {"recordings": True, "application": "1.2", **given}
    return write_backup(target, storage.folder.path, location, **given)

"""Uploaded calibrations: reading, description and storage."""

from __future__ import annotations

import asyncio
import contextlib
import io
import math
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from app.contract.calibrating import TapeCheck
from app.contract.commands import MeasureDepth, TakeScenePairs
from app.contract.values import LONGEST_NAME, JsonObject, filled, of_plain, plain
from app.runtime.jobs import Progress
from app.server.asking import ask
from app.server.contracts import Engine
from app.server.errors import Conflict, FieldError, NotThere
from app.storage import CalibrationRecord, RunRecord, Storage, utc_now
from app.workers.calibration.messages import Refined, RefineRows
from app.workers.calibration.process import work
from observer.calibration.ageing.row_refinement import RowRefinement
from observer.calibration.fitting.lens import horizontal_field_of_view
from observer.calibration.formats.exporting import ExportKind, export_calibration
from observer.calibration.formats.opencv_file import calibration_text, read_calibration
from observer.calibration.formats.recognition import read_any
from observer.calibration.formats.understanding import Cameras, NamedFile
from observer.calibration.formats.units import LengthUnit, UnitUnclear, parse_unit
from observer.calibration.report import depth_bias_of
from observer.calibration.tape import tape_check
from observer.camera import StereoCalibration
from observer.errors import CalibrationError, InputError
from observer.intervals import half_95
from observer.number_format import format_number

_FILE_FIELD, _UNIT_FIELD = ("body", "file"), ("body", "unit")
_MOST_CHECKS = 50


def calibration_facts(calibration: StereoCalibration) -> JsonObject:
    """Return the facts of a calibration for a list."""
    return {
        "width": calibration.width,
        "height": calibration.height,
        "baseline_m": round(calibration.baseline, 6),
        "hfov_deg": round(math.degrees(horizontal_field_of_view(calibration)), 2),
        "rectified": calibration.is_rectified,
    }


def keep_upload(
    storage: Storage,
    files: Sequence[NamedFile],
    *,
    size: tuple[int, int] | None,
    unit: str | None,
    cameras: Cameras | None,
) -> CalibrationRecord:
    """Read an upload in any supported format and store it.

    A complete OpenCV file is stored unchanged; the others are stored as OpenCV YAML.

    Args:
        size, cameras: as for ``read_any``. unit: as for ``parse_unit``; None for the format's own.

    Raises:
        FieldError: the files are not a usable calibration; one sentence says why.
        StorageError: it could not be stored.
    """
    length_unit = _length_unit(unit)
    try:
        understood = read_any(files, size=size, unit=length_unit, cameras=cameras)
    except UnitUnclear as error:
        raise FieldError(_UNIT_FIELD, str(error.asking("set unit to {}"))) from error
    except CalibrationError as error:
        raise FieldError(_FILE_FIELD, str(error)) from error
    text = _as_it_came(files) if length_unit is None else None
    info = {
        **calibration_facts(understood.calibration),
        "origin": f"uploaded: {understood.format}",
        "notes": list(understood.notes),
    }
    name = " and ".join(file.name for file in files)[:LONGEST_NAME]
    return storage.save_calibration(
        text or calibration_text(understood.calibration), name=name, info=info
    )


def _length_unit(said: str | None) -> LengthUnit | None:
    if said is None or not said.strip():
        return None
    try:
        return parse_unit(said)
    except CalibrationError as error:
        raise FieldError(_UNIT_FIELD, str(error)) from error


def _as_it_came(files: Sequence[NamedFile]) -> str | None:
    """Return the text of a single file if the engine can read it unchanged, else None."""
    if len(files) != 1:
        return None
    try:
        text = files[0].content.decode("utf-8-sig")
        read_calibration(text, name=files[0].name)
    except (UnicodeDecodeError, CalibrationError):
        return None
    return text


def keep_own_calibration(storage: Storage, text: str, run: RunRecord) -> RunRecord:
    """Store the source's own calibration with a run: the source may change, the run must not.

    It is not listed, because nobody uploaded it; the run refers to it by its content hash.
    """
    calibration = read_calibration(text, name=f"the calibration of {run.source}")
    kept = storage.save_calibration(
        text,
        name=f"of {run.source}",
        info=calibration_facts(calibration),
        listed=False,
    )
    return storage.update_run(run.id, calibration_id=kept.id)


def find_kept_calibration(storage: Storage, id: str) -> CalibrationRecord:
    """Return a calibration that is listed or that a run refers to.

    Raises:
        NotThere: there is none with that id.
    """
    record = storage.get_calibration(id)
    if record is None:
        raise NotThere(f"there is no calibration {id[:80]!r}; it may have been deleted")
    return record


def find_calibration(storage: Storage, id: str) -> CalibrationRecord:
    """Return a listed calibration.

    Raises:
        NotThere: there is none with that id.
    """
    record = find_kept_calibration(storage, id)
    if not record.listed:
        raise NotThere(f"the calibration {record.name} belongs to a run; upload its file to use it")
    return record


def exported(record: CalibrationRecord, kind: ExportKind) -> NamedFile:
    """Convert the calibration for another tool; several files become one ZIP archive."""
    calibration = read_calibration(record.text, name=record.name)
    name = f"calibration-{record.id[:12]}"
    files = export_calibration(calibration, kind, name=name)
    if len(files) == 1:
        return files[0]
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        for each in files:
            # Other tools expect left.yaml and right.yaml.
            file.writestr(each.name.removeprefix(f"{name}-"), each.content)
    return NamedFile(f"{name}-{kind}.zip", archive.getvalue())


async def check_by_tape(
    engine: Engine, storage: Storage, record: CalibrationRecord, u: float, v: float, tape_m: float
) -> CalibrationRecord:
    """Compare the depth of a point with a tape measure and store the result with the calibration.

    Args:
        tape_m: straight-line distance from the left lens to the point.

    Raises:
        FieldError: the point has no depth, or the calibration does not fit the images.
        Conflict: there are no images. NotAvailable: there is no engine at the moment.
        StorageError: it was not stored.
    """
    place = await ask(engine, MeasureDepth(record.text, u, v), field=("body", "u"))

    def info(now: CalibrationRecord) -> JsonObject:
        return {"tape_checks": with_tape_check(now, place.range_m, tape_m)}

    return await asyncio.to_thread(storage.change_calibration, record.id, info=info)


def with_tape_check(record: CalibrationRecord, rig_m: float, tape_m: float) -> list[Any]:
    """Return the tape checks of a calibration with a new one added, in stored form.

    Report fields damaged by hand count as unknown, as for an uploaded calibration.

    Args:
        rig_m, tape_m: range of the point as measured by the rig and by the tape.

    Raises:
        FieldError: the lengths cannot be compared.
    """
    calibration = read_calibration(record.text, name=record.name)
    report = record.info.get("report") or {}
    square_m, bias, lasting_px = None, None, 0.0
    with contextlib.suppress(ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        square_m = of_plain(_Board, report.get("board") or {}).square_m
        bias, lasting_px = depth_bias_of(report)
    try:
        check = tape_check(
            calibration, rig_m, tape_m, square_m=square_m, bias=bias, lasting_px=lasting_px
        )
    except InputError as error:
        raise FieldError(("body", "measured_m"), str(error)) from error
    kept: list[TapeCheck] = []
    with contextlib.suppress(ValueError):
        kept = of_plain(list[TapeCheck], record.info.get("tape_checks", []))
    made = filled(TapeCheck, check, measured_m=tape_m, stated_m=rig_m, at=utc_now())
    return [plain(each) for each in (*kept, made)][-_MOST_CHECKS:]


@dataclass(frozen=True)
class _Board:
    square_m: Annotated[float, Field(gt=0, lt=10)] | None = None


async def refine_rows(
    engine: Engine, storage: Storage, active: CalibrationRecord | None
) -> CalibrationRecord:
    """Make a new calibration with rows, and a drifted vergence, corrected from recent images.

    The calibration in use stays in use, unchanged.

    Raises:
        Conflict: these images cannot refine it; one sentence says why.
        NotAvailable: there is no engine at the moment. StorageError: it could not be stored.
    """
    name = "the source's own" if active is None else active.name
    seen = await ask(engine, TakeScenePairs())
    job = RefineRows(seen.calibration_yaml, name, seen.pairs, seen.vergence)
    try:
        refined = await work(job, _unheard)
    except CalibrationError as error:
        raise Conflict(str(error)) from error
    assert isinstance(refined, Refined)
    figures = {
        name: None if value is None else float(value)
        for name, value in vars(refined.refinement).items()
        if name != "calibration"
    }
    calibration = read_calibration(refined.calibration_yaml, name=name)
    origin = f"refined from {name}: {_changes(refined.refinement)}"
    info = {**calibration_facts(calibration), "origin": origin, "refinement": figures}
    if active is not None and "bound" in active.info:
        info["bound"] = active.info["bound"]
    name = f"{name}, refined {utc_now()[:10]}"[:LONGEST_NAME]
    save = storage.save_calibration
    return await asyncio.to_thread(save, refined.calibration_yaml, name=name, info=info)


def _changes(found: RowRefinement) -> str:
    """Describe in words what a refinement changed."""
    rows = f"epipolar error {found.before_px:.2f} px before, {found.after_px:.2f} px after"
    pitch, roll = math.degrees(found.pitch_rad), math.degrees(found.roll_rad)
    turns = f"pitch {_turn(pitch)}, roll {_turn(roll)}"
    if found.vergence_rad is None or found.vergence_std_rad is None:
        return f"{rows}; {turns}, vergence unchanged"
    vergence, sigma = math.degrees(found.vergence_rad), math.degrees(found.vergence_std_rad)
    return f"{rows}; {turns}, vergence {_turn(vergence)} ± {half_95(sigma):.3f}° (95 % interval)"


def _turn(degrees: float) -> str:
    return f"{format_number(degrees, 3, signed=True)}°"


def _unheard(_: Progress) -> None:
    """Ignore progress: the work takes only a second or two."""

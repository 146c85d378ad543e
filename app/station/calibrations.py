"""Calibrations that people upload: read, described, kept."""

from __future__ import annotations

import math
from typing import Any

from app.messages import PreviewCalibration
from app.station.asking import ask
from app.station.contracts import Engine
from app.station.errors import FieldError, NotThere
from app.storage import CalibrationRecord, RunRecord, Storage
from observer.calibration.formats.opencv_file import read_calibration
from observer.camera import StereoCalibration
from observer.errors import CalibrationError

_FILE_FIELD = ("body", "file")


def calibration_facts(calibration: StereoCalibration) -> dict[str, Any]:
    """What a list shows of a calibration."""
    half_width = calibration.width / 2
    return {
        "width": calibration.width,
        "height": calibration.height,
        "baseline_m": round(calibration.baseline, 6),
        "hfov_deg": round(math.degrees(2 * math.atan(half_width / calibration.K1[0, 0])), 2),
        "rectified": calibration.is_rectified,
    }


def keep_upload(storage: Storage, content: bytes, name: str) -> CalibrationRecord:
    """Check an uploaded file and keep it.

    Raises:
        FieldError: the file is no usable calibration; one sentence says why.
        StorageError: it could not be kept.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FieldError(
            _FILE_FIELD, f"{name} is no text; send an OpenCV FileStorage file in YAML"
        ) from None
    try:
        calibration = read_calibration(text, name=name)
    except CalibrationError as error:
        raise FieldError(_FILE_FIELD, str(error)) from error
    return storage.save_calibration(text, name=name, info=calibration_facts(calibration))


def keep_own_calibration(storage: Storage, text: str, run: RunRecord) -> RunRecord:
    """Keep the calibration that came with a run's source: the source may change, the run not.

    It is not listed, since nobody uploaded it; the run refers to it by its content hash.
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
    """A listed calibration, or one that a run refers to.

    Raises:
        NotThere: there is none of that id.
    """
    record = storage.get_calibration(id)
    if record is None:
        raise NotThere(f"there is no calibration {id[:80]!r}; GET /api/calibrations lists them")
    return record


def find_calibration(storage: Storage, id: str) -> CalibrationRecord:
    """A listed calibration.

    Raises:
        NotThere: there is none of that id.
    """
    record = find_kept_calibration(storage, id)
    if not record.listed:
        raise NotThere(f"the calibration {record.name} belongs to a run; upload its file to use it")
    return record


async def preview_calibration(engine: Engine, record: CalibrationRecord) -> dict[str, Any]:
    """The newest pair rectified with a calibration; see ``PreviewCalibration``.

    Raises:
        FieldError: it does not fit the images. Conflict: there are no images.
        NotAvailable: there is no engine at the moment.
    """
    command = PreviewCalibration(record.text)
    return await ask(engine, command, field=("path", "id"), timeout_s=20.0)

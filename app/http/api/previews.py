"""A rectified pair as an answer: the image, with its figures in the headers."""

from __future__ import annotations

from typing import Any

from fastapi import Response

from app.contract.commands import PreviewCalibration
from app.http.api.refusals import refusals
from app.server import Server
from app.server.asking import ask

PREVIEW_RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "content": {"image/jpeg": {}},
        "headers": {
            "X-Vertical-Error-Px": {
                "description": "Median epipolar error of matches; absent if there were too few.",
                "schema": {"type": "number"},
            },
            "X-Matches": {"schema": {"type": "integer"}},
        },
    },
    **refusals(404, 409, 422, 503),
}


async def preview_response(server: Server, calibration_yaml: str) -> Response:
    """Answer with the newest pair rectified by a calibration."""
    command = PreviewCalibration(calibration_yaml)
    preview = await ask(server.engine, command, field=("path", "id"), timeout_s=20.0)
    headers = {"X-Matches": str(preview.matches)}
    if preview.vertical_error_px is not None:
        headers["X-Vertical-Error-Px"] = f"{preview.vertical_error_px:.3f}"
    return Response(preview.jpeg, media_type="image/jpeg", headers=headers)

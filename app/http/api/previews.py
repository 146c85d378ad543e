"""A rectified pair as an answer: the image, with its figures in the headers."""

from __future__ import annotations

from typing import Any

from fastapi import Response

from app.contract.answers import CalibrationPreview
from app.http.api.refusals import refusals

PREVIEW_RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "content": {"image/jpeg": {}},
        "headers": {
            "X-Vertical-Error-Px": {
                "description": "Median vertical distance of matching points; absent where there "
                "were too few.",
                "schema": {"type": "number"},
            },
            "X-Matches": {"schema": {"type": "integer"}},
        },
    },
    **refusals(404, 409, 422, 503),
}


def preview_response(preview: CalibrationPreview) -> Response:
    """The reply of ``PreviewCalibration`` as HTTP."""
    headers = {"X-Matches": str(preview.matches)}
    if preview.vertical_error_px is not None:
        headers["X-Vertical-Error-Px"] = f"{preview.vertical_error_px:.3f}"
    return Response(preview.jpeg, media_type="image/jpeg", headers=headers)

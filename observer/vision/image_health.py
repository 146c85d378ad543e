"""Watches from frame to frame whether the two cameras deliver what can be used."""

from __future__ import annotations

from observer.camera import StereoCamera
from observer.methods.contract import Step, View
from observer.parameters import Parameters
from observer.vision.image_checks import (
    exposure_reason,
    frozen_reason,
    rectification_reason,
    swapped_reason,
    vertical_error,
)

# One equal pair may be a repeated frame of a video.
_FROZEN_FRAMES = 2
# Rows drift slowly; looking now and then is enough, and what was found stays until the next look.
_ROWS_EVERY = 5
# Below this share of features with depth it is worth asking whether the cameras are swapped.
_POOR_STEREO = 0.35
_SWAPPED_EVERY = 10


class HealthWatch:
    """Gives one sentence for everything that is wrong with the images of a frame."""

    def __init__(self, camera: StereoCamera) -> None:
        self._camera = camera
        self._previous: View | None = None
        self._frozen = 0
        self._frames = 0
        self._rows: str | None = None
        self._swapped: str | None = None

    def look(self, view: View, step: Step | None, parameters: Parameters) -> tuple[str, ...]:
        """What is wrong with this view.

        Args:
            step: what the method made of it; None for the first view of a segment.
        """
        exposure = exposure_reason(view.left, view.right)
        frozen = self._look_frozen(view)
        if exposure is None and step is not None:
            self._look_at_stereo(view, step, parameters)
        self._frames += 1
        return tuple(r for r in (exposure, frozen, self._swapped, self._rows) if r is not None)

    def _look_frozen(self, view: View) -> str | None:
        previous, self._previous = self._previous, view
        reason = None
        if previous is not None:
            reason = frozen_reason(previous.left, previous.right, view.left, view.right)
        self._frozen = 0 if reason is None else self._frozen + 1
        return reason if self._frozen >= _FROZEN_FRAMES else None

    def _look_at_stereo(self, view: View, step: Step, parameters: Parameters) -> None:
        if step.stereo_share >= _POOR_STEREO:
            self._swapped = None
        elif self._frames % _SWAPPED_EVERY == 0:
            self._swapped = swapped_reason(
                view.left, view.right, parameters.stereo.max_disparity_px
            )
        if step.rows is not None and self._frames % _ROWS_EVERY == 0:
            error = vertical_error(step.rows.px, step.rows.offset_px, self._camera)
            self._rows = None if error is None else rectification_reason(error)

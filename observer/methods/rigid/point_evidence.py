"""Motion of each tracked feature, as it is shown and explained."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array


@dataclass(frozen=True, eq=False)
class PointEvidence:
    """The motion of N followed features at one frame, and how sure it is.

    Attributes:
        px: (N, 2) float32 pixels in the rectified left image of this frame.
        depth: (N,) metres, NaN = unknown.
        age_s: (N,) seconds for which each has been followed.
        velocity: (N, 3) m/s over ground, camera axes, pooled over the neighbours.
        velocity_std: (N,) m/s, one standard deviation of it.
        significance: (N,) Mahalanobis length of the velocity: standard deviations from standing.
        threshold: the Mahalanobis length above which a feature counts as dynamic.
        dynamic: (N,) which ones count as dynamic.
        neighbours: (N,) how many features were pooled.
        obstacle_id: (N,) number of the obstacle each belongs to, -1 = none;
            below that it is not confirmed yet.

    Raises:
        ValueError: the arrays differ in length.
    """

    px: NDArray[np.float32]
    depth: Float64Array
    age_s: Float64Array
    velocity: Float64Array
    velocity_std: Float64Array
    significance: Float64Array
    threshold: float
    dynamic: NDArray[np.bool_]
    neighbours: NDArray[np.int_]
    obstacle_id: NDArray[np.int_]

    def __post_init__(self) -> None:
        count = len(self.px)
        shapes = {"px": (count, 2), "velocity": (count, 3)}
        for name in (
            "px", "depth", "age_s", "velocity", "velocity_std", "significance", "dynamic",
            "neighbours", "obstacle_id",
        ):  # fmt: skip
            expected = shapes.get(name, (count,))
            shape = np.shape(getattr(self, name))
            if shape != expected:
                raise ValueError(f"the evidence's {name} must have shape {expected}, not {shape}")

    def __len__(self) -> int:
        return len(self.px)

"""Labels of obstacles: the same wording in images, the 3D scene and figures."""

from __future__ import annotations

from observer.intervals import half_95


def obstacle_label(number: int, motion: str, speed: float, std: float | None = None) -> str:
    """Return a label, as in ``#3  0.41 ± 0.02 m/s``; one that moves in place has no speed.

    Args:
        motion: its ``MotionState``. speed, std: m/s, and one standard deviation; None: without
            interval.
    """
    if motion == "in_place":
        return f"#{number}  in place"
    interval = "" if std is None else f" ± {half_95(std):.2f}"
    return f"#{number}  {speed:.2f}{interval} m/s"

"""Cost of live capture for the loop, as Markdown."""

from __future__ import annotations

from observer.evaluation.evaluate import markdown_table
from observer.evaluation.targets import targets_table
from tools.benchmark.live_capture import SLOW_S, CaptureFigures, Loop, Spread


def capture_markdown(figures: CaptureFigures) -> str:
    """Return tables of the targets, the loops' times, and the arrival of the pairs."""
    width, height = figures.image_size
    return "\n".join(
        [
            f"## Live capture at {width}x{height} and {figures.camera_rate:g} images a second, "
            f"targets\n",
            targets_table({"measured": figures.targets}, "figure, median"),
            "## The loops, ms per frame, p10 / median / p95\n",
            markdown_table(
                ["loop", "frames", "per second", "read: CPU", "read: without waiting for images",
                 "work", "CPU in total", "grabbed to delivered", "errors"],
                [
                    _row("processes what cameras send", figures.live),
                    _row("processes the same from memory", figures.memory),
                    _row(f"sleeps {1e3 * SLOW_S:g} ms instead of processing", figures.slow),
                    _row("the same, with the cameras served in between", figures.tending),
                ],
            ),
            "## The pairs of the cameras\n",
            markdown_table(
                ["sync error median", "sync error p95", "pairs", "dropped"],
                [
                    [
                        _ms(figures.skew_median_ms), _ms(figures.skew_p95_ms),
                        str(figures.pairs), str(figures.dropped),
                    ]
                ],
            ),
        ]
    )  # fmt: skip


def _row(name: str, loop: Loop) -> list[str]:
    return [
        name, str(loop.frames), f"{loop.rate:.1f}", _both(loop.read_cpu_ms),
        _both(loop.read_wall_ms), _both(loop.work_ms), _both(loop.cpu_ms),
        _both(loop.latency_ms), str(loop.troubles),
    ]  # fmt: skip


def _both(spread: Spread) -> str:
    return f"{spread.p10:.2f} / {spread.median:.2f} / {spread.p95:.2f}"


def _ms(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f} ms"

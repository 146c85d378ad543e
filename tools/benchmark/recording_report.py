"""Cost of recording for the loop, as Markdown."""

from __future__ import annotations

from observer.evaluation.evaluate import markdown_table
from observer.evaluation.targets import targets_table
from tools.benchmark.recording_cost import RATE, RecordingFigures


def recording_markdown(figures: RecordingFigures) -> str:
    """Return tables of the targets, the loop's rates, and the engine's memory."""
    width, height = figures.image_size
    return "\n".join(
        [
            f"## Recording {width}x{height} at {RATE:g} pairs a second, targets\n",
            targets_table({"measured": figures.targets}, "figure"),
            "## The loop in a running server, unique frames per second\n",
            markdown_table(
                ["played at", "images", "without", "recorded", "ratio", "MB per s", "dropped"],
                [
                    [
                        f"{rate.playback_rate:g} x", rate.images, f"{rate.without:.1f}",
                        f"{rate.recorded:.1f}", f"{rate.ratio:.2f}", f"{rate.mb_per_s:.1f}",
                        str(rate.dropped),
                    ]
                    for rate in figures.rates
                ],
            ),
            _memory_line(figures),
        ]
    )  # fmt: skip


def _memory_line(figures: RecordingFigures) -> str:
    memory = figures.memory_mb
    if not memory:
        return "The system does not report the engine's memory.\n"
    return (
        f"The engine's memory over {figures.minutes:.1f} min: {memory[0]:.0f} MB first, "
        f"{min(memory):.0f} to {max(memory):.0f} MB, {memory[-1]:.0f} MB last.\n"
    )

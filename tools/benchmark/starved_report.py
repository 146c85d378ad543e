"""Figures of a starved server, as Markdown."""

from __future__ import annotations

from observer.evaluation.evaluate import markdown_table
from observer.evaluation.targets import targets_table
from tools.benchmark.starved import StarvedFigures


def starved_markdown(figures: StarvedFigures) -> str:
    """Return tables of the targets and of what was measured."""
    ages = (figures.age_median_s, figures.age_p95_s, figures.age_max_s)
    return "\n".join(
        [
            f"## {figures.share:.0%} of one core, targets\n",
            targets_table({"measured": figures.targets}, "figure"),
            "## Measured\n",
            markdown_table(
                ["cameras, fps", "observed, fps", "age: median / p95 / max, ms", "reduced to",
                 "drive loop late"],
                [
                    [
                        f"{figures.camera_rate:.1f}",
                        f"{figures.rate:.1f}",
                        " / ".join(f"{1e3 * age:.0f}" for age in ages),
                        figures.reduced_to or "full processing",
                        "-" if figures.drive is None else figures.drive.words,
                    ]
                ],
            ),
        ]
    )  # fmt: skip

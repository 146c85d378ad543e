"""Figures of the loop in a running server, as Markdown."""

from __future__ import annotations

from observer.evaluation.evaluate import markdown_table
from observer.evaluation.targets import targets_table
from tools.benchmark.browser import PageFigures
from tools.benchmark.served import DenseCloudRates, DriveLateness, ServedFigures, StalledRates


def served_markdown(served: ServedFigures) -> str:
    """Return tables of the targets, the loop with and without viewers and dense cloud, viewers
    beside one that reads nothing, and one page.
    """
    return "\n".join(
        [
            "## Viewers, targets\n",
            targets_table({"measured": served.targets}, "figure"),
            "## The loop in a running server, unique frames per second\n",
            markdown_table(
                ["played at", "alone", "with viewers", "ratio", "viewers", "scene messages",
                 "observations", "images", "failures"],
                [
                    [
                        f"{r.playback_rate:g} x", f"{r.alone:.1f}", f"{r.with_viewers:.1f}",
                        f"{r.ratio:.2f}", str(r.viewers), str(r.scene_messages),
                        str(r.observation_messages), str(r.image_messages), str(len(r.failures)),
                    ]
                    for r in served.rates
                ],
            ),
            f"\n{drive_line(served)}",
            "\n## Viewers beside a stalled one, per second\n",
            _stalled_table(served.stalled),
            "\n## The dense cloud beside the loop\n",
            _dense_cloud_table(served.dense_cloud),
            "\n## One visible page\n",
            served.page if isinstance(served.page, str) else _page_table(served.page),
        ]
    )  # fmt: skip


def drive_line(served: ServedFigures) -> str:
    """Describe the lateness of the drive loop in one sentence."""
    summary = "; ".join(
        f"at {r.playback_rate:g} x {_late(r.drive)}, while a run is recorded {_late(r.recorded)}"
        for r in served.rates
    )
    return f"The drive loop's lateness with viewers, over its last 30 s: {summary}."


def _late(drive: DriveLateness | None) -> str:
    return "there was no drive process" if drive is None else drive.words


def _stalled_table(stalled: StalledRates) -> str:
    return markdown_table(
        ["figure", "without", "beside it"],
        [
            [name, f"{without:.1f}", f"{beside:.1f}"]
            for name, without, beside in (
                ("frames observed", stalled.without.frames, stalled.beside.frames),
                ("observations", stalled.without.observations, stalled.beside.observations),
                ("images", stalled.without.images, stalled.beside.images),
            )
        ],
    ) + "".join(f"\nA viewer failed: {each}." for each in stalled.failures)


def _dense_cloud_table(rates: DenseCloudRates) -> str:
    def shown(value: float | None, factor: float = 1.0) -> str:
        return "never" if value is None else f"{factor * value:.0f} ms"

    return markdown_table(
        ["played at", "loop without", "loop with", "ratio", "clouds per s", "age", "cost of one",
         "downscaling factor", "failures"],
        [
            [
                f"{rates.playback_rate:g} x", f"{rates.without:.1f}", f"{rates.watched:.1f}",
                f"{rates.ratio:.2f}", f"{rates.clouds_per_s:.1f}", shown(rates.age_s, 1e3),
                shown(rates.median_ms), str(rates.coarseness), str(len(rates.failures)),
            ]
        ],
    )  # fmt: skip


def _page_table(page: PageFigures) -> str:
    def shown(value: float | None, unit: str) -> str:
        return "never" if value is None else f"{value:.1f} {unit}"

    return markdown_table(
        ["figure", "value"],
        [
            ["first obstacle after the server's start", shown(page.first_obstacle_s, "s")],
            ["received to painted, median", shown(page.latency_median_ms, "ms")],
            ["received to painted, p95", shown(page.latency_p95_ms, "ms")],
            ["observations acknowledged", str(page.count)],
        ],
    )

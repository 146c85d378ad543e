"""Figures of a soak, as Markdown."""

from __future__ import annotations

from observer.evaluation.evaluate import markdown_table
from observer.intervals import half_95
from tools.benchmark.soak import MOST_MB_PER_HOUR, Growth, SoakFigures, sampled

_ROWS = 24
_VERDICTS = {True: "yes", False: "**no**", None: "too short to tell"}


def soak_markdown(figures: SoakFigures) -> str:
    """Return tables of the samples over time and of each process's growth."""
    judged = figures.evenings[figures.warm_up :]
    names = list(figures.evenings[0].use)
    minutes = 60 * figures.evenings[-1].hours
    return "\n".join(
        [
            f"## Soak of {minutes:.0f} min: {figures.runs} runs in {len(figures.evenings)} days\n",
            "Memory in MB without pages of files, threads, descriptors, when all have left.\n",
            markdown_table(
                ["min", *names, "processes"],
                [
                    [
                        f"{60 * each.hours:.1f}",
                        *(
                            f"{use.memory_mb:.1f}, {use.threads}, {use.descriptors}"
                            for use in each.use.values()
                        ),
                        str(each.processes),
                    ]
                    for each in sampled(figures.evenings, _ROWS)
                ],
            ),
            f"\n## Growth of {len(judged)} days, the first {figures.warm_up} left out\n",
            markdown_table(
                ["process", f"memory, 95 % interval, <= {MOST_MB_PER_HOUR:g} MB/h", "threads",
                 "descriptors", "held"],
                [_row(each) for each in figures.growths],
            ),
            f"\nThe number of processes {'grew' if figures.processes_grow else 'did not grow'}. "
            f"The log grew to {figures.log_mb:.2f} MB with {figures.tracebacks} tracebacks.",
            *(f"Refused {count} times: {said}" for said, count in figures.refusals.items()),
        ]
    )  # fmt: skip


def _row(growth: Growth) -> list[str]:
    memory = growth.memory
    memory_cell = (
        "too few samples"
        if memory is None
        else f"{memory.per_hour:.2f} ± {half_95(memory.std):.2f}"
    )
    grow = (growth.threads_grow, growth.descriptors_grow)
    counts = ["grow" if each else "do not grow" for each in grow]
    return [growth.process, memory_cell, *counts, _VERDICTS[growth.held]]

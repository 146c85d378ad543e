"""Report as one self-contained HTML file: no script, no external address, images inside."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from html import escape
from importlib.resources import files

from matplotlib.figure import Figure

from app.reports.report import Report
from app.reports.report_figure import ReportFigure
from observer.evaluation.speed_errors import SpeedErrors
from observer.figures import figure_bytes, themed_svg
from observer.intervals import half_95
from observer.navigation.parameters import AllParameters
from observer.number_format import format_number

_HEADER = (
    "", "Samples", "Bias, m/s", "RMSE, m/s", "Max. error, m/s", "Within 95 % interval", "Measured",
)  # fmt: skip
_GROUPS = {
    "all": "", "direction": "Moving ", "way": "Body moving ", "body": "Body ", "track": "Track ",
}  # fmt: skip
# Labels that do not follow the words for their group.
_LABELS = {"whole run": "Whole run", "at rest": "At rest", "left": "Moving to the left",
           "right": "Moving to the right"}  # fmt: skip


def report_html(report: Report) -> str:
    """Return the whole page."""
    style = files("app.reports").joinpath("page.css").read_text(encoding="utf-8")
    facts = report.facts
    title = escape(f"{facts.name or facts.id}: report")
    body = "\n".join(
        (
            f"<header><h1>{escape(facts.name or facts.id)}</h1>{_summary(report)}</header>",
            _section("Figures", "figures", _figures(report.figures)),
            _section("Speed errors", "errors", _errors(report)),
            _section("Ground truth and alignment", "truth", _truth(report)),
            _section("Segments and frames", "segments", _segments(report)),
            _section("Incidents", "incidents", _incidents(report)),
            _section("Parameters", "parameters", _parameters(report)),
            _section("Calibration", "calibration", f"<pre>{escape(facts.calibration_yaml)}</pre>"),
            _section("Versions", "versions", _table(("Package", "Version"),
                                                    sorted(facts.versions.items()))),
        )
    )  # fmt: skip
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>\n{style}</style></head>\n<body><main>\n{body}\n"
        f"</main></body></html>\n"
    )


def _summary(report: Report) -> str:
    facts = report.facts
    began = datetime.fromtimestamp(facts.anchor.wall_ns / 1e9, UTC)
    rows = [
        ("Run ID", facts.id),
        ("Source", facts.source),
        ("Started", f"{began:%Y-%m-%d %H:%M:%S} UTC"),
        ("Duration", f"{_length(report.duration_s)}, {report.frames} frames"),
        ("Recorded images", facts.images),
        ("Preset", facts.preset or "none"),
        *sorted(facts.notes.items()),
    ]
    if report.unfinished:
        rows.append(
            (
                "Recording",
                "cut off: the recording has no end; everything up to that point is shown here",
            )
        )
    cells = "".join(f"<dt>{escape(k)}</dt><dd>{escape(str(v))}</dd>" for k, v in rows)
    return f"<dl>{cells}</dl>"


def _length(duration_s: float | None) -> str:
    """Return the length as the dashboard words it."""
    if duration_s is None:
        return "no frames"
    tenths = round(10 * duration_s)
    minutes, rest = divmod(tenths, 600)
    hours, minutes = divmod(minutes, 60)
    words = [f"{hours} h"] if hours else []
    words += [f"{minutes} min"] if hours or minutes else []
    return " ".join([*words, f"{rest / 10:.1f} s"])


def _figures(figures: Sequence[ReportFigure]) -> str:
    """Return the figures made, then each reason why others are missing, once."""
    made: list[str] = []
    missing: dict[str, list[str]] = {}
    for each in figures:
        heading = f"Figure {each.number}. {each.title}"
        if each.figure is None:
            missing.setdefault(each.missing, []).append(heading)
        else:
            made.append(_figure(each, each.figure, heading))
    for reason, headings in missing.items():
        listed = "".join(f"<li>{escape(heading)}</li>" for heading in headings)
        made.append(
            f'<div class="missing"><p><b>Not shown:</b> {escape(reason)}</p><ul>{listed}</ul></div>'
        )
    return "".join(made)


def _figure(each: ReportFigure, figure: Figure, heading: str) -> str:
    if each.kind == "chart":
        shown = themed_svg(figure, each.name)
        shown = f'<div class="chart" role="img" aria-label="{escape(heading)}">{shown}</div>'
    else:
        data = base64.b64encode(figure_bytes(figure, each.name, "jpg")).decode()
        shown = f'<img alt="{escape(heading)}" src="data:image/jpeg;base64,{data}">'
    return (
        f'<figure id="{each.name}">{shown}<figcaption><b>{escape(heading)}.</b> '
        f"{escape(each.caption)}</figcaption></figure>"
    )


def _errors(report: Report) -> str:
    if not report.errors:
        # The next section says where ground truth comes from, or why there is none.
        return "<p>Errors cannot be computed.</p>"
    table = _table(_HEADER, [_error_row(each) for each in report.errors]) + _compared(report)
    changes = "; ".join(f"{escape(body)}: {n}" for body, n in report.changes.items()) or "none"
    return (
        f"{table}<p>Identity switches: {changes}. An error is the estimated speed minus the true "
        "speed at the same instant; ground truth is interpolated only between neighbouring "
        "samples. <em>Measured</em> is the share of time with an estimate while the body "
        "moved in view.</p>"
    )


def _compared(report: Report) -> str:
    """Tabulate each experiment by method and direction; empty without experiments."""
    if not report.judged:
        return ""
    rows = [
        [each.experiment, each.method, *_error_row(errors)]
        for each in report.judged
        for errors in each.errors
        if errors.group in ("all", "direction")
    ]
    return f"<h3>By experiment and method</h3>{_table(('Experiment', 'Method', *_HEADER), rows)}"


def _error_row(errors: SpeedErrors) -> list[str]:
    figures = (errors.bias_mps, errors.rmse_mps, errors.maximum_mps)
    named = f"{_GROUPS[errors.group]}{errors.label}"
    if errors.group in ("all", "direction"):
        named = _LABELS.get(errors.label, named)
    if errors.group == "track":
        named = f"{named} of {errors.body}"
    return [
        named,
        str(errors.samples),
        *("–" if value is None else format_number(value, 3) for value in figures),
        "–" if errors.coverage is None else f"{100 * errors.coverage:.0f} %",
        "–" if errors.seen_share is None else f"{100 * errors.seen_share:.0f} %",
    ]


def _truth(report: Report) -> str:
    said = f"<p>{escape(report.gathered.truth_words)}</p>"
    alignment = report.gathered.alignment
    if alignment is None:
        return said
    time = alignment.time
    rows = [
        (
            "Time offset of the ground truth",
            f"{format_number(time.offset_s, 4)} ± {half_95(time.sigma_s):.4f} s (95 % interval)",
        ),
        ("Drift", f"{format_number(time.drift_ppm, 1)} ppm"),
        ("Correlation", f"{time.correlation:.3f}"),
        ("Overlap", f"{time.overlap_s:.1f} s"),
        ("Speed residual", f"{time.residual_mps:.3f} m/s"),
        (
            "Position residual",
            "unknown"
            if alignment.frame_residual_m is None
            else f"{alignment.frame_residual_m:.3f} m",
        ),
        *((f"{name} is", role) for name, role in alignment.roles.items()),
    ]
    notes = "".join(f"<li>{escape(note)}</li>" for note in alignment.notes)
    return f"{said}{_table(('Quantity', 'Value'), rows)}<ul>{notes}</ul>"


def _segments(report: Report) -> str:
    segments = [(str(n), f"{time:.2f}") for n, time in report.segments.items()]
    statuses = [(status, str(n)) for status, n in sorted(report.statuses.items())]
    return _table(("Segment", "Start, s"), segments) + _table(("Status", "Frames"), statuses)


def _incidents(report: Report) -> str:
    if not report.incidents:
        return "<p>None were recorded.</p>"
    begin = report.facts.anchor.monotonic
    rows = [(format_number(i.received - begin, 2), i.kind, i.sentence) for i in report.incidents]
    return _table(("Time, s", "Incident", ""), rows)


def _parameters(report: Report) -> str:
    if not report.revisions:
        return "<p>None were recorded; default values are assumed.</p>"
    first, *later = report.revisions
    default = AllParameters().flat()
    rows = [(name, _word(v), _word(default.get(name))) for name, v in sorted(first.values.items())]
    changed = [row for row in rows if row[1] != row[2]]
    said = _table(("Changed parameter", "Value", "Default"), changed) if changed else (
        "<p>All started at their default values.</p>"
    )  # fmt: skip
    if later:
        changes = [
            (str(r.revision), "–" if r.frame is None else str(r.frame), name, _word(value))
            for r in later
            for name, value in sorted(r.difference.items())
        ]
        said += _table(("Revision", "From frame", "Parameter", "Value"), changes)
    whole = _table(("Parameter", "Initial value"), [row[:2] for row in rows])
    return f"{said}<details><summary>All {len(rows)} parameters</summary>{whole}</details>"


def _word(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _section(title: str, name: str, content: str) -> str:
    return f'<section id="{name}"><h2>{escape(title)}</h2>{content}</section>'


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    head = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in header)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows
    )
    return (
        f'<div class="table"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )

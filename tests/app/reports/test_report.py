"""The report of a short run, and of one that holds too little."""

from __future__ import annotations

import csv
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from app.cli.command_line import build
from app.reports.gathering import gather
from app.reports.page import report_html
from app.reports.report import Report, make_report, write_figures
from observer.recording.reader import Recording

from .conftest import record


class _Page(HTMLParser):
    """Checks whether all elements are closed, and collects references."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.ids: list[str] = []
        self.references: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("src", "href", "xlink:href") and value:
                self.references.append(value)
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if self.open and self.open[-1] == tag:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="session")
def html(report: Report) -> str:
    return report_html(report)


def test_every_figure_is_generated(report: Report) -> None:
    assert [each.number for each in report.figures] == [str(n) for n in range(9, 18)]
    assert {each.number: each.missing for each in report.figures if each.missing} == {
        "10": "The source of this run, simulated:lab, is a simulator: figure 9 shows it.",
        "14": "The source of this run, simulated:lab, is a simulator: figure 13 shows it.",
    }
    assert {each.number for each in report.figures if each.figure is None} == {"10", "14"}
    # The frame is named with the rule that chose it, and it is a frame of the run.
    named = re.search(r"Frame (\d+), t = .* most significant detection", report.figures[0].caption)
    assert named is not None
    assert 0 < int(named[1]) < 12
    assert report.gathered.commanded[0].speeds == pytest.approx(0.4)


def test_an_undriven_robot_has_the_commands_of_its_scenario(tmp_path: Path) -> None:
    path = record(tmp_path / "r.mcap", images="none", frames=4, sent=(0.0, "disarmed"))
    with Recording(path) as recording:
        (commanded,) = gather(recording).commanded
    assert commanded.label == "P3-DX, commanded"
    assert commanded.speeds.max() > 0.3


def test_errors_are_computed_from_the_run(report: Report) -> None:
    whole = report.errors[0]
    assert whole.samples > 5
    assert whole.rmse_mps is not None
    assert whole.rmse_mps < 0.05
    assert {each.label for each in report.errors if each.group == "direction"} == {"right"}
    assert report.changes == {"P3-DX": 0}


def test_the_page_is_self_contained_and_complete(html: str) -> None:
    page = _Page()
    page.feed(html)
    page.close()
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    assert "script" not in page.tags
    assert all(each.startswith(("#", "data:")) for each in page.references)
    assert not re.search(r"@import|url\((?!#)", html)
    assert html.count('src="data:image/jpeg;base64,') == 6
    for each in (
        *(f"Figure {number}." for number in range(9, 18)),
        "a &lt;short&gt; run", "A &lt;guard&gt; stop.", "20260101-120000-abcdef",
        "simulated:lab", "2023-11-14 22:13:20 UTC", "dynamic-observer", "0.1.0",
        "K1: !!opencv-matrix", "flow.residual_threshold_px", "1.25", "Moving to the right",
        "Ground truth was recorded with the run.", "RMSE, m/s", "prefers-color-scheme: dark",
        "@media print",
    ):  # fmt: skip
        assert each in html, each
    assert "<short>" not in html
    assert re.search(r"<td>2</td><td>9</td><td>flow\.residual_threshold_px</td>", html)


def test_missing_recordings_are_stated(bare: Path, tmp_path: Path) -> None:
    made = make_report(bare, lambda _done, _of: None)
    html = report_html(made)
    # Each reason once, below what is shown; the point cloud of figure 16 has one of its own.
    assert html.count("<b>Not shown:</b> recording.mcap was recorded without images") == 2
    assert html.count("<li>Figure ") == 8
    assert html.index("Figure 17.") < html.index("Figure 9.")
    assert html.count("The recording contains no ground truth to compare with.") == 1
    assert "Errors cannot be computed." in html
    assert "data:image" not in html
    written = {path.name for path in write_figures(made, tmp_path / "figures")}
    assert written == {
        "figure17.png", "figure17.svg", "figure17.pdf", "speeds.csv", "errors.csv", "run.json",
    }  # fmt: skip
    assert (tmp_path / "figures" / "figure17.pdf").read_bytes().startswith(b"%PDF")


def test_exported_data_match_the_figures(report: Report, tmp_path: Path) -> None:
    charts = Report(**{**vars(report), "figures": report.figures[-1:]})
    write_figures(charts, tmp_path / "a")
    with (tmp_path / "a" / "speeds.csv").open() as file:
        rows = list(csv.DictReader(file))
    seen = [row for row in rows if row["source"] == "observer"]
    (motion,) = report.gathered.seen
    assert [float(row["speed_mps"]) for row in seen] == motion.speeds.tolist()
    assert [float(row["time_s"]) for row in seen] == motion.times.tolist()
    assert {row["source"] for row in rows} == {"observer", "truth", "commanded"}
    # The same data give the same figures and tables, to the last byte.
    write_figures(charts, tmp_path / "b")
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name


def test_the_command_refuses_a_missing_run(
    tmp_path: Path, bare: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from observer.errors import InputError

    def call(*arguments: str) -> None:
        build()(args=["report", *arguments], standalone_mode=False)

    output = tmp_path / "page.html"
    with pytest.raises(InputError, match="there is no run"):
        call("20200101-000000-000000", "--output", str(output), "--data", str(tmp_path))
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="there is no recording"):
        call("missing.mcap", "--output", str(output))
    with pytest.raises(InputError, match="cannot write"):
        call(str(bare), "--output", "/proc/no/page.html")
    call(str(bare), "--output", str(output))
    assert "Figure 17" in output.read_text()
    assert "without figures 9, 10" in capsys.readouterr().err

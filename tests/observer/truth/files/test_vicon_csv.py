"""Vicon's CSV files: what is read from them, and how errors are named."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from observer.errors import TruthError

from .conftest import BOM, DEVICES, Read, nexus_csv, places, tracker_csv

COUNT = 30
# Tilted too far for either kind of angle to pass as the other.
TURNED = Rotation.from_euler("z", np.linspace(0, 3, COUNT)[:, None]) * Rotation.from_euler("x", 0.6)
HELICAL = TURNED.as_rotvec()
EULER = TURNED.as_euler("XYZ")


def test_reads_tracker_objects(read: Read) -> None:
    seen, lost = places(COUNT, seed=1), places(COUNT, seed=2)
    lost[4:7] = np.nan
    angles = HELICAL.copy()
    angles[4:7] = np.nan
    file = tracker_csv({"pioneer:pioneer": (HELICAL, seen), "amigo:wand": (angles, lost)}, first=11)
    capture = read(file)
    assert capture.format == "Vicon Tracker objects"
    assert capture.rate_hz == 100
    assert list(capture.bodies) == ["pioneer", "amigo:wand"]
    pioneer, amigo = capture.bodies.values()
    np.testing.assert_allclose(pioneer.times, 0.1 + np.arange(COUNT) / 100, atol=1e-12)
    np.testing.assert_allclose(pioneer.positions, seen / 1000, atol=1e-12)
    np.testing.assert_allclose(pioneer.rotations, TURNED.as_matrix(), atol=1e-5)
    assert (pioneer.gaps, amigo.gaps) == (0, 3)
    assert amigo.rotations is not None
    np.testing.assert_array_equal(np.isnan(amigo.rotations).all(axis=(1, 2)), ~amigo.seen)
    assert any("helical" in note for note in capture.notes)
    assert "gaps: 3 of 60 samples are missing, in 1 of 2 bodies" in capture.notes


def test_reads_segments_in_degrees_and_other_units(read: Read) -> None:
    file = tracker_csv(
        {"Subject:Head": (np.degrees(EULER), places(COUNT) / 1000)},
        title="Segments", units="deg,deg,deg,m,m,m", prefix="", rate="250.5",
    )  # fmt: skip
    capture = read(file, angles="euler_xyz")
    assert capture.format == "Vicon segments"
    assert capture.rate_hz == 250.5
    head = capture.bodies["Subject:Head"]
    np.testing.assert_allclose(head.positions, places(COUNT) / 1000, atol=1e-5)
    np.testing.assert_allclose(head.rotations, TURNED.as_matrix(), atol=1e-5)


def test_reads_quaternions(read: Read) -> None:
    file = tracker_csv(
        {"robot": (TURNED.as_quat(), places(COUNT))},
        columns="RX,RY,RZ,RW,TX,TY,TZ", units=",,,,mm,mm,mm",
    )  # fmt: skip
    body = read(file).bodies["robot"]
    np.testing.assert_allclose(body.rotations, TURNED.as_matrix(), atol=1e-5)
    with pytest.raises(TruthError, match=r"upload line 5 cell 3: of robot, RX, RY, RZ, RW must be"):
        read(tracker_csv(
            {"robot": (2 * TURNED.as_quat(), places(COUNT))}, rate=None,
            columns="RX,RY,RZ,RW,TX,TY,TZ", units=",,,,mm,mm,mm"), rate_hz=100)  # fmt: skip


@pytest.mark.parametrize("rate", [None, "", "1"])
def test_asks_for_a_missing_rate(read: Read, rate: str | None) -> None:
    file = tracker_csv({"robot": (HELICAL, places(COUNT))}, rate=rate)
    with pytest.raises(TruthError) as caught:
        read(file)
    assert str(caught.value) == (
        "upload: the file does not state its frame rate (Tracker 3.5 omits it); give the frame "
        "rate of the capture system in Hz"
    )
    capture = read(file, rate_hz=120)
    assert capture.rate_hz == 120
    assert capture.bodies["robot"].times[-1] == pytest.approx((COUNT - 1) / 120)


def test_given_rate_overrides_the_file_and_is_noted(read: Read) -> None:
    file = tracker_csv({"robot": (HELICAL, places(COUNT))})
    capture = read(file, rate_hz=50)
    assert capture.rate_hz == 50
    assert "the rate is 50 Hz as requested, although the file says 100 Hz" in capture.notes
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(TruthError, match="the frame rate must be above 0"):
            read(file, rate_hz=wrong)


@pytest.mark.parametrize("before", [True, False])
def test_ignores_devices_with_a_note(read: Read, before: bool) -> None:
    trajectories = nexus_csv({"box:left": places(COUNT)})
    file = DEVICES + trajectories if before else trajectories + "\r\n" + DEVICES
    capture = read(file)
    assert capture.format == "Vicon Nexus trajectories"
    np.testing.assert_allclose(capture.bodies["box:left"].positions, places(COUNT) / 1000)
    assert "ignored, because it contains no positions: Devices" in capture.notes
    with pytest.raises(TruthError, match="it contains only Devices; export Objects"):
        read(DEVICES)


def test_reads_two_sections_and_distinguishes_equal_names(read: Read) -> None:
    segments = tracker_csv({"a": (HELICAL, places(COUNT))}, title="Segments", prefix="")
    trajectories = nexus_csv({"a": places(COUNT, seed=1), "": places(COUNT, seed=2)})
    capture = read(segments + trajectories)
    assert capture.format == "Vicon segments and Nexus trajectories"
    assert list(capture.bodies) == ["a", "a (2)", "unnamed"]
    assert capture.bodies["a (2)"].rotations is None


def test_reads_spreadsheet_exports_with_semicolons(read: Read) -> None:
    file = nexus_csv({"left": places(COUNT)}).replace(",", ";").replace(".", ",")
    np.testing.assert_allclose(read(file).bodies["left"].positions, places(COUNT) / 1000)


def test_reads_names_in_the_windows_code_page(read: Read) -> None:
    capture = read(nexus_csv({"Daphnée": places(COUNT)}).encode("cp1252"))
    assert list(capture.bodies) == ["Daphnée"]
    assert "the text is not Unicode and is read as Windows-1252" in capture.notes


def test_zero_samples_and_short_rows_are_gaps(read: Read) -> None:
    angles, seen = HELICAL.copy(), places(COUNT)
    angles[3] = seen[3] = 0
    rows = tracker_csv({"robot": (angles, seen)}).split("\r\n")
    rows[10] = "6,0"
    body = read("\r\n".join(rows)).bodies["robot"]
    assert np.flatnonzero(~body.seen).tolist() == [3, 5]


@pytest.mark.parametrize(
    ("line", "text", "expected"),
    [
        (8, "3,0,0,0,0,1,x,3", "upload line 8 cell 7: TY of robot must be a number, not 'x'"),
        (8, "3,0,0,0,0,1,1_0,3", "upload line 8 cell 7: TY of robot must be a number, not '1_0'"),
        (8, "3,0,0,0,0,1,1e999,3", "upload line 8 cell 7: TY of robot must be a finite number"),
        (8, "3,0,0,0,0,1,,3", "upload line 8 cell 3: of robot, its position must be given in all"),
        (8, "3,0,0,0,0,1,2", "upload line 8 cell 3: of robot, its position must be given in all"),
        (8, "3,0,0,0,0,1,1e200,3", "upload line 8 cell 3: of robot, its position must be within"),
        (8, "3,0,0,1e200,0,1,1,3", "upload line 8 cell 3: of robot, its angles must be within"),
        (8, "3,0,0,0,0,1,2,3,4", "upload line 8: the row has 9 cells, but the header has 8"),
        (8, "2,0,0,0,0,1,2,3", "upload line 8 cell 1: frame 2 does not follow frame 2"),
        (8, "2.5,0,0,0,0,1,2,3", "upload line 8 cell 1: Frame must be a whole number"),
        (8, ",0,0,0,0,1,2,3", "upload line 8 cell 1: Frame must be a whole number"),
        (8, "3,1,0,0,0,1,2,3", "upload line 8 cell 2: Sub Frame must be 0"),
        (8, '3,0,"0,0,0,1,2,3', "upload line 8: the line is not valid CSV"),
        (8, "", "upload line 12: a section must start with its title"),
        (5, ",,rad,rad,rad,mm,mm,m", "upload line 5 cell 8: the unit 'm' must be a length"),
        (5, ",,rad,rad,turns,mm,mm,mm", "upload line 5 cell 5: the unit 'turns' must be an angle"),
        (5, "1,0,0,0,0,1,2,3", "upload line 5 cell 6: the unit '1' must be a length"),
        (4, "Frame,Sub Frame,RX,RY,RZ,TX,TY,Q", "upload line 4 cell 3: the columns from 'RX' on"),
        (4, "Frame,Sub Frame", "upload line 4: no columns after Frame and Sub Frame"),
        (4, "Picture,Part", "upload line 4: a section must start with its title"),
    ],
)  # fmt: skip
def test_refusal_names_the_line_and_cell(read: Read, line: int, text: str, expected: str) -> None:
    rows = tracker_csv({"robot": (HELICAL, places(COUNT))}).split("\r\n")
    rows[line - 1] = text
    with pytest.raises(TruthError) as caught:
        read("\r\n".join(rows))
    assert expected in str(caught.value)


def test_refuses_a_file_without_samples(read: Read) -> None:
    file = tracker_csv({"robot": (HELICAL, places(COUNT))}).split("\r\n")[:5]
    with pytest.raises(TruthError, match="the section Objects contains no samples"):
        read("\r\n".join(file))
    with pytest.raises(TruthError, match="a section must start with its title"):
        read(BOM + "Objects\r\n")


def test_reads_a_long_file_in_a_few_seconds(read: Read) -> None:
    # A tenth of 30 minutes of 10 bodies at 100 Hz; a full file takes 3 s.
    count = 18_000
    row = ",".join(f"{value:.6g}" for value in np.concatenate([HELICAL[5], places(1)[0]]))
    header = tracker_csv({f"robot {k}": (HELICAL[:1], places(1)) for k in range(10)})
    rows = header.split("\r\n")[:5]
    rows += [f"{k},0," + ",".join([row] * 10) for k in range(1, count + 1)]
    content = "\r\n".join(rows)
    capture = read(content)
    assert all(len(body.times) == count for body in capture.bodies.values())

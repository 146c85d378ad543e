"""Calibration files over REST: every format in, three out, and what is kept with them."""

from __future__ import annotations

import asyncio
import io
import zipfile
from typing import Any

import numpy as np
import pytest

from app.contract.commands import MeasureDepth
from observer.calibration.formats.exporting import export_calibration
from observer.calibration.formats.recognition import read_any
from observer.calibration.formats.understanding import NamedFile
from observer.camera import StereoCalibration

from .wire import JSON

RIG = StereoCalibration(
    640,
    480,
    K1=np.array([[500.0, 0, 320], [0, 501, 240], [0, 0, 1]]),
    D1=np.array([-0.1, 0.02, 0, 0]),
    K2=np.array([[499.0, 0, 318], [0, 500, 241], [0, 0, 1]]),
    D2=np.array([-0.2, 0.1, 0, 0]),
    R=np.eye(3),
    T=np.array([-0.12, 0.001, 0.002]),
)
FISHEYE = StereoCalibration(
    640, 480, RIG.K1, np.zeros(4), RIG.K2, np.zeros(4), RIG.R, RIG.T, "equidistant"
)


def texts(*contents: str) -> tuple[NamedFile, ...]:
    return tuple(NamedFile(f"file{i}.txt", text.encode()) for i, text in enumerate(contents))


def row(key: str, *values: float) -> str:
    return f"{key}: {' '.join(map(str, values))}\n"


KITTI = "".join(
    row(f"P{i}", 700, 0, 600, -380.0 * (i % 2), 0, 700, 180, 0, 0, 0, 1, 0) for i in range(2)
)
MIDDLEBURY = (
    "cam0=[1000 0 300; 0 1000 200; 0 0 1]\ncam1=[1000 0 310; 0 1000 200; 0 0 1]\ndoffs=10\n"
    "baseline=100\nwidth=640\nheight=480\nndisp=64\n"
)
ZED = (
    "".join(
        f"[{side}_CAM_HD]\nfx=700\nfy=700\ncx=640\ncy=360\nk1=-0.17\nk2=0.03\n"
        for side in ("LEFT", "RIGHT")
    )
    + "[STEREO]\nBaseline=120\nRX_HD=0.001\nCV_HD=0.002\nRZ_HD=0.003\n"
)
EUROC = (
    "T_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, {x}, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
    "resolution: [752, 480]\ncamera_model: pinhole\nintrinsics: [458.0, 457.0, 367.0, 248.0]\n"
    "distortion_model: radial-tangential\ndistortion_coefficients: [-0.28, 0.07, 0, 0]\n"
)
# Words of the origin -> files, form fields, width (px) and baseline (m).
FORMATS: dict[str, tuple[tuple[NamedFile, ...], dict[str, str], int, float]] = {
    "OpenCV": (export_calibration(RIG, "opencv", "a"), {}, 640, RIG.baseline),
    "ROS": (export_calibration(RIG, "ros", "a"), {}, 640, RIG.baseline),
    "Kalibr": (export_calibration(RIG, "kalibr", "a"), {}, 640, RIG.baseline),
    "KITTI odometry": (texts(KITTI), {"size": "1241x376"}, 1241, 380 / 700),
    "Middlebury": (texts(MIDDLEBURY), {}, 640, 0.1),
    "ZED": (texts(ZED), {"size": "1280 x 720"}, 1280, 0.12),
    "EuRoC": (texts(EUROC.format(x=0), EUROC.format(x=0.11)), {}, 752, 0.11),
}


async def send(served: Any, files: Any, **told: str) -> Any:
    parts = [("file", (file.name, file.content, "application/octet-stream")) for file in files]
    return await served.http.post("/api/calibrations", files=parts, data=told)


def opencv(calibration: StereoCalibration = RIG) -> tuple[NamedFile, ...]:
    return export_calibration(calibration, "opencv", "mine")


# --- in -------------------------------------------------------------------------------------


async def test_every_format_is_imported_with_notes(served: Any) -> None:
    ids: set[str] = set()

    for name, (files, told, width, baseline) in FORMATS.items():
        answer = await send(served, files, **told)
        assert answer.status_code == 201, (name, answer.text)
        entry = answer.json()
        assert entry["origin"].startswith("uploaded: "), name
        assert name in entry["origin"]
        assert entry["notes"], name
        assert entry["width"] == width, name
        assert entry["baseline_m"] == pytest.approx(baseline, abs=2e-6), name
        assert entry["name"] == " and ".join(file.name for file in files)
        assert (entry["active"], entry["report"], entry["tape_checks"]) == (False, None, [])
        text = (await served.http.get(f"/api/calibrations/{entry['id']}/file")).content
        again = read_any([NamedFile("again", text)]).calibration
        assert (again.width, again.baseline) == (width, pytest.approx(baseline))
        ids.add(entry["id"])
    # Identified by content: equal calibrations from two formats are one.
    listed = (await served.http.get("/api/calibrations")).json()
    assert {each["id"] for each in listed} == ids
    assert len(ids) >= len(FORMATS) - 2


async def test_an_uploaded_file_is_stored_unchanged_unless_rescaled(
    served: Any,
) -> None:
    (file,) = opencv()
    whole = (await send(served, [file])).json()
    kept = await served.http.get(f"/api/calibrations/{whole['id']}/file")
    assert kept.content == file.content
    millimetres = file.content.replace(b"-0.12", b"-120.0").replace(b"0.001", b"1.0")
    read = await send(served, [NamedFile("mm.yaml", millimetres)], unit="mm")
    assert read.status_code == 201, read.text
    assert read.json()["baseline_m"] == pytest.approx(0.12, abs=1e-4)


async def test_a_missing_unit_is_requested_and_may_be_a_square_size(served: Any) -> None:
    (file,) = opencv()
    squares = NamedFile("squares.yaml", file.content.replace(b"-0.12", b"-4.8"))
    asked = await send(served, [squares])
    (problem,) = asked.json()["detail"]
    assert (asked.status_code, problem["loc"]) == (422, ["body", "unit"])
    assert problem["msg"].startswith("squares.yaml: T gives a baseline of 4.8")
    assert problem["msg"].endswith("if in squares of a board of 25 mm, set unit to 25mm")
    assert "--unit" not in problem["msg"]
    read = await send(served, [squares], unit=" 25mm ")
    assert read.status_code == 201, read.text
    assert read.json()["baseline_m"] == pytest.approx(0.12, abs=1e-4)
    assert "T converted from units of 25 mm: baseline 0.12 m" in read.json()["notes"]
    # An empty form field.
    assert (await send(served, opencv(), unit="")).status_code == 201


REFUSED: dict[str, tuple[Any, dict[str, str], str]] = {
    "one of two": (lambda: FORMATS["ROS"][0][:1], {}, "left.yaml and right.yaml"),
    "three": (lambda: opencv() * 3, {}, "3 files were given"),
    "eleven": (lambda: opencv() * 30, {}, "files were given"),
    "not of one kind": (lambda: (*opencv(), *FORMATS["EuRoC"][0][:1]), {}, "belong together"),
    "no size": (lambda: texts(KITTI), {}, "size"),
    "missing key": (
        lambda: texts(MIDDLEBURY.replace("baseline=100\n", "")),
        {},
        "file0.txt: baseline",
    ),
    "no number": (
        lambda: texts(MIDDLEBURY.replace("baseline=100", "baseline=nan")),
        {},
        "baseline",
    ),
    "a single camera": (lambda: texts("camera_matrix: [1]\n"), {}, "a single camera"),
    "zip": (lambda: [NamedFile("a.zip", b"PK\x03\x04" + bytes(99))], {}, "this is a ZIP archive"),
    "nothing": (lambda: texts("hello: 1\n"), {}, "not a known calibration format"),
    "alias bomb": (lambda: texts("a: &a [x,x]\nb: [*a,*a]\n"), {}, "file0.txt"),
}


async def test_refusals_name_file_and_key(served: Any) -> None:
    for name, (files, told, words) in REFUSED.items():
        answer = await send(served, files(), **told)
        assert answer.status_code == 422, (name, answer.text)
        (problem,) = answer.json()["detail"]
        assert problem["loc"] == ["body", "file"], name
        assert words in problem["msg"], (name, problem["msg"])
        assert len(problem["msg"]) < 400
    for told in (
        *({"size": text} for text in ("640", "640x", "-1x5", "axb", "1e3x4", "999999x1")),
        {"unit": "inch"},
        {"cameras": "both"},
    ):
        answer = await send(served, opencv(), **told)
        assert answer.status_code == 422, (told, answer.text)
        assert answer.json()["detail"][0]["loc"] == ["body", next(iter(told))]
    assert (await served.http.get("/api/calibrations")).json() == []


async def test_file_names_are_stripped_of_paths(served: Any) -> None:
    (file,) = opencv()
    for given, name in (
        ("../../etc/my cal.yaml", "my cal.yaml"),
        ("C:\\users\\me\\c.yaml", "c.yaml"),
        ("x" * 300 + ".yaml", "x" * 100),
        ("/", "calibration.yaml"),
    ):
        entry = (await send(served, [NamedFile(given, file.content)])).json()
        assert entry["name"] == name


# --- out ------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["opencv", "ros", "kalibr"])
async def test_exported_calibrations_can_be_imported_again(served: Any, kind: str) -> None:
    id = (await send(served, opencv())).json()["id"]
    out = await served.http.get(f"/api/calibrations/{id}/export/{kind}")
    assert out.status_code == 200
    assert 'filename="calibration-' in out.headers["content-disposition"]
    files = [NamedFile("it", out.content)]
    if kind == "ros":
        with zipfile.ZipFile(io.BytesIO(out.content)) as archive:
            files = [NamedFile(name, archive.read(name)) for name in archive.namelist()]
        assert len(files) == 2
    again = read_any(files).calibration
    assert again.baseline == pytest.approx(RIG.baseline, abs=1e-6)
    assert np.allclose(again.K1, RIG.K1)


async def test_a_format_that_cannot_represent_a_calibration_is_refused(served: Any) -> None:
    id = (await send(served, opencv(FISHEYE))).json()["id"]
    for kind in ("opencv", "ros", "kalibr"):
        out = await served.http.get(f"/api/calibrations/{id}/export/{kind}")
        assert out.status_code in (200, 422), (kind, out.text)
    assert (await served.http.get(f"/api/calibrations/{id}/export/matlab")).status_code == 422
    for missing in ("0" * 64, "..%2f..%2fetc%2fpasswd"):
        out = await served.http.get(f"/api/calibrations/{missing}/export/ros")
        assert out.status_code == 404


# --- beside it ------------------------------------------------------------------------------


async def test_a_calibration_in_use_can_be_renamed_but_not_deleted(http: Any, served: Any) -> None:
    entry = (await send(served, opencv())).json()
    path = f"/api/calibrations/{entry['id']}"
    assert (await http.post(f"{path}/activate")).is_success
    renamed = await http.patch(path, json={"name": "Robot 3 ü"})
    assert renamed.json() == {**entry, "name": "Robot 3 ü", "active": True}
    assert (await http.get("/api/status")).json()["calibration"]["name"] == "Robot 3 ü"
    for body in ("{}", '{"name": ""}', '{"name": 1}', '{"name": "a\\u0000"}', '{"x": 1}'):
        answer = await http.patch(path, content=body, headers=JSON)
        assert answer.status_code == 422, body
    refused = await http.delete(path)
    assert refused.status_code == 409
    assert "Robot 3 ü is in use; deactivate it first" in refused.json()["detail"]
    missing = f"/api/calibrations/{'0' * 64}"
    assert (await http.patch(missing, json={"name": "x"})).status_code == 404
    assert (await http.delete(missing)).status_code == 404
    await http.post("/api/calibrations/deactivate")
    assert (await http.delete(path)).status_code == 204


async def test_tape_checks_are_stored_and_survive_another_upload(
    http: Any, served: Any, peer: Any
) -> None:
    entry = (await send(served, opencv())).json()
    path = f"/api/calibrations/{entry['id']}"
    depth = await http.get(f"{path}/depth?u=100&v=50.5")
    assert depth.json() == {"range_m": 2.0, "depth_m": 1.9, "disparity_px": 28.0}
    assert isinstance(peer.commands[-1], MeasureDepth)
    assert (peer.commands[-1].u, peer.commands[-1].v) == (100.0, 50.5)
    body = {"u": 100, "v": 50.5, "measured_m": 2.01}
    checked = await http.post(f"{path}/tape-checks", json=body)
    assert checked.status_code == 201, checked.text
    (check,) = checked.json()["tape_checks"]
    assert (check["measured_m"], check["stated_m"], check["agrees"]) == (2.01, 2.0, True)
    assert check["expected_m"] > 0.01
    assert check["sentence"]
    off = await http.post(f"{path}/tape-checks", json={**body, "measured_m": 3.0})
    assert [each["agrees"] for each in off.json()["tape_checks"]] == [True, False]
    # Uploading the same file again keeps its tape checks.
    again = (await send(served, opencv())).json()
    assert again["tape_checks"] == off.json()["tape_checks"]
    (listed,) = (await http.get("/api/calibrations")).json()
    assert len(listed["tape_checks"]) == 2


async def test_two_operators_who_check_at_once_both_keep_their_check(
    http: Any, served: Any
) -> None:
    path = f"/api/calibrations/{(await send(served, opencv())).json()['id']}/tape-checks"
    lengths = [1.99, 2.0, 2.01, 2.02]
    answers = await asyncio.gather(
        *(http.post(path, json={"u": 100, "v": 50.5, "measured_m": each}) for each in lengths)
    )
    assert [answer.status_code for answer in answers] == [201] * 4
    (listed,) = (await http.get("/api/calibrations")).json()
    assert sorted(each["measured_m"] for each in listed["tape_checks"]) == lengths


async def test_an_invalid_measurement_is_refused(http: Any, served: Any) -> None:
    path = f"/api/calibrations/{(await send(served, opencv())).json()['id']}"
    plain = {"u": "1", "v": "1", "measured_m": "2.0"}
    for key in plain:
        for value in ("NaN", "1e999", "true", '"1"', "-1", "null", "1e6"):
            body = ", ".join(f'"{k}": {value if k == key else v}' for k, v in plain.items())
            answer = await http.post(f"{path}/tape-checks", content=f"{{{body}}}", headers=JSON)
            assert answer.status_code == 422, body
            assert answer.json()["detail"][0]["loc"] == ["body", key], body
    for query in ("", "u=1", "u=nan&v=1", "u=1&v=1e999", "u=true&v=1", "u=-1&v=1"):
        answer = await http.get(f"{path}/depth?{query}")
        assert answer.status_code == 422, query
        assert answer.json()["detail"][0]["loc"][0] == "query"
    outside = await http.get(f"{path}/depth?u=600&v=1")
    assert outside.json()["detail"][0]["loc"] == ["query", "u"]
    near = await http.post(f"{path}/tape-checks", json={"u": 1, "v": 1, "measured_m": 0.01})
    assert near.json()["detail"][0]["loc"] == ["body", "measured_m"]
    listed = (await http.get("/api/calibrations")).json()
    assert listed[0]["tape_checks"] == []
    missing = f"/api/calibrations/{'0' * 64}"
    assert (await http.get(f"{missing}/depth?u=1&v=1")).status_code == 404


async def test_refining_without_images_is_refused_and_replaces_nothing(http: Any) -> None:
    answer = await http.post("/api/calibrations/refine")
    assert answer.status_code == 409
    assert "let the cameras run for a few seconds" in answer.json()["detail"]
    assert (await http.get("/api/calibrations")).json() == []

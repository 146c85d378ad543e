"""File names in answers and in uploads."""

from __future__ import annotations

from typing import Any

import pytest

from app.http.file_name import content_disposition, encoded_name
from app.server.runs.files import file_stem
from app.storage import Storage


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("ride.mcap", 'attachment; filename="ride.mcap"'),
        ("figure 17 (b).csv", 'attachment; filename="figure 17 (b).csv"'),
        ("Größe.csv", "attachment; filename*=utf-8''Gr%C3%B6%C3%9Fe.csv"),
        ('a"; b\\.csv', "attachment; filename*=utf-8''a%22%3B%20b%5C.csv"),
        ("a\r\nb.csv", "attachment; filename*=utf-8''a%0D%0Ab.csv"),
    ],
)
def test_any_file_name_is_encoded_safely_in_the_header(name: str, told: str) -> None:
    assert content_disposition(name) == told


@pytest.mark.parametrize(
    ("disposition", "name"),
    [
        ("form-data; filename=a.csv; filename*=utf-8''Gr%C3%B6%C3%9Fe.csv", "Größe.csv"),
        ("form-data; filename*=ISO-8859-1'de'Gr%F6%DFe.csv; filename=a.csv", "Größe.csv"),
        ("form-data; filename*=\"utf-8''a%20b.csv\"", "a b.csv"),
        ("form-data; filename*=utf-8''a%FF.csv", "a\ufffd.csv"),
        ("form-data; filename*=klingon''a.csv; filename=a.csv", None),
        ("form-data; filename=a.csv", None),
    ],
)
def test_an_encoded_name_is_read(disposition: str, name: str | None) -> None:
    assert encoded_name(disposition) == name


async def test_an_upload_has_its_encoded_name(http: Any) -> None:
    async def upload(names: str) -> Any:
        head = f'--x\r\nContent-Disposition: form-data; name="file"; {names}\r\n\r\n'
        return await http.post(
            "/api/truth",
            content=f"{head}time,x,y,z\n0,1,2,3\n1,1,2,3\n\r\n--x--\r\n".encode(),
            headers={"Content-Type": "multipart/form-data; boundary=x"},
        )

    name = "filename*=utf-8''..%2F..%2FGr%C3%B6%C3%9Fe%00.csv"
    sent = await upload(f'filename="=?utf-8?B?R3LDtsOfZS5jc3Y=?="; {name}')
    assert sent.status_code == 201, sent.text
    assert sent.json()["name"] == "Größe.csv"
    alone = await upload(name)
    assert alone.status_code == 422
    assert alone.json()["detail"][0]["msg"] == (
        'file must be a file: give its part of the form a filename="..."'
    )


@pytest.mark.parametrize(
    ("name", "stem"),
    [
        ("a/b: c?", "a_b_ c_"),
        ("Run of simulated:lab", "Run of simulated_lab"),
        ("x" * 200, "x" * 80),
    ],
)
def test_a_run_name_becomes_a_file_name(storage: Storage, name: str, stem: str) -> None:
    with storage:
        run = storage.create_run(name=name, source="b", parameters={}, versions={})
        assert file_stem(run) == stem
        dots = storage.create_run(name=" .. ", source="b", parameters={}, versions={})
        assert file_stem(dots) == dots.id

"""File names in answers."""

from __future__ import annotations

import pytest

from app.http.file_name import content_disposition
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

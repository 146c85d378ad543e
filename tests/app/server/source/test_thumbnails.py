"""Pictures of sources are made once, one at a time, and kept."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from app.runtime.worker import JobFailed
from app.server.errors import NotThere
from app.server.source.hints import source_entries
from app.server.source.thumbnails import Thumbnails

LAB, PEOPLE = source_entries()[:2]


class Maker:
    """Makes pictures when it is allowed to."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.at_once = self.most_at_once = 0
        self.began, self.let = asyncio.Event(), asyncio.Event()

    async def __call__(self, spec: str) -> bytes:
        self.asked.append(spec)
        self.began.set()
        self.at_once += 1
        self.most_at_once = max(self.most_at_once, self.at_once)
        try:
            await self.let.wait()
        finally:
            self.at_once -= 1
        if spec.startswith("/"):
            raise JobFailed("it holds no images")
        return spec.encode()


async def test_a_picture_is_made_once_for_many_requests(tmp_path: Path) -> None:
    make = Maker()
    pictures = Thumbnails(tmp_path / "thumbnails", make)
    asking = [asyncio.ensure_future(pictures.find(each)) for each in (LAB, LAB, PEOPLE)]
    await make.began.wait()
    assert len(make.asked) == 1
    make.let.set()
    assert await asyncio.gather(*asking) == [
        b"simulated:lab",
        b"simulated:lab",
        b"simulated:people",
    ]
    assert sorted(make.asked) == [LAB.spec, PEOPLE.spec]
    assert make.most_at_once == 1
    # Another server finds them in the folder.
    again = Maker()
    assert await Thumbnails(tmp_path / "thumbnails", again).find(LAB) == b"simulated:lab"
    assert again.asked == []


async def test_a_leaving_client_cancels_the_picture_and_the_next_restarts_it(
    tmp_path: Path,
) -> None:
    make = Maker()
    pictures = Thumbnails(tmp_path, make)
    leaving = asyncio.ensure_future(pictures.find(LAB))
    await make.began.wait()
    leaving.cancel()
    await asyncio.gather(leaving, return_exceptions=True)
    assert make.at_once == 0
    make.let.set()
    assert await pictures.find(LAB) == b"simulated:lab"


async def test_a_source_without_picture_is_not_retried_until_it_changes(tmp_path: Path) -> None:
    make = Maker()
    make.let.set()
    folder = tmp_path / "images"
    folder.mkdir()
    entry = replace(LAB, spec=str(folder), title="images", group="folders")
    pictures = Thumbnails(tmp_path / "thumbnails", make)
    for _ in range(2):
        with pytest.raises(NotThere, match="no picture of images: it holds no images"):
            await pictures.find(entry)
    assert len(make.asked) == 1
    (folder / "left").mkdir()
    with pytest.raises(NotThere):
        await pictures.find(entry)
    assert len(make.asked) == 2
    with pytest.raises(NotThere):
        await pictures.find(replace(LAB, picture=False))


async def test_an_unwritable_cache_still_gives_the_picture(tmp_path: Path) -> None:
    make = Maker()
    make.let.set()
    (tmp_path / "thumbnails").touch()
    assert await Thumbnails(tmp_path / "thumbnails", make).find(LAB) == b"simulated:lab"

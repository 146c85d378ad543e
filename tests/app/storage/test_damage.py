"""Damaged backups: what is extracted is what was written, or one sentence says why not."""

from __future__ import annotations

import io
import json
import tarfile
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from app.storage.bundle import BackupError, Manifest, bundle_writer, open_bundle

from ...damage import damaged, examples, hostile_bytes, read_or_refused

FILES = {"observer.sqlite": b"rows" * 40, "truths/a.csv": b"t,x,y,z\n0,1,2,3\n"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damage")


@pytest.fixture(scope="module")
def wholes(folder: Path) -> tuple[bytes, ...]:
    """The same backup as a zip and as a tar."""
    made = []
    for ending in ("zip", "tar"):
        target = folder / f"backup.{ending}"
        with bundle_writer(target) as writer:
            for number, (name, content) in enumerate(FILES.items()):
                (folder / str(number)).write_bytes(content)
                writer.add(name, folder / str(number))
            writer.finish(Manifest("2026-01-01T00:00:00Z", "0.1.0", "0001", False, writer.files))
        made.append(target.read_bytes())
    return tuple(made)


def restored(path: Path) -> dict[str, bytes]:
    with open_bundle(path) as bundle, TemporaryDirectory() as folder:
        target = Path(folder)
        for name in bundle.manifest.files:
            bundle.extract(name, target / name)
        return {name: (target / name).read_bytes() for name in bundle.manifest.files}


@pytest.mark.parametrize("which", [0, 1], ids=["zip", "tar"])
def test_what_is_written_is_read_back(folder: Path, wholes: tuple[bytes, ...], which: int) -> None:
    (folder / "whole").write_bytes(wholes[which])
    assert restored(folder / "whole") == FILES


@pytest.mark.parametrize("which", [0, 1], ids=["zip", "tar"])
@examples(60)
@given(data=st.data())
def test_a_damaged_backup_is_refused_or_whole(
    folder: Path, wholes: tuple[bytes, ...], which: int, data: st.DataObject
) -> None:
    path = folder / "damaged"
    path.write_bytes(data.draw(damaged([wholes[which]], (b"PK\x05\x06", b"ustar"))))
    found = read_or_refused(lambda: restored(path), BackupError)
    # The list of files has no checksum of its own: what it calls a file may have changed.
    assert found is None or sorted(found.values()) == sorted(FILES.values())


@examples(40)
@given(hostile_bytes((b"PK\x03\x04", b"PK\x05\x06", b"ustar\x0000")))
@example(tarfile.TarInfo("manifest.json").tobuf() + bytes(1024))
def test_what_is_no_backup_is_refused(folder: Path, content: bytes) -> None:
    path = folder / "none"
    path.write_bytes(content)
    with pytest.raises(BackupError):
        restored(path)


@examples(40)
@given(data=st.data())
def test_a_damaged_list_of_files_is_refused_or_whole(folder: Path, data: st.DataObject) -> None:
    whole = {
        "kind": "dynamic-observer backup", "version": 1, "made_at": "2026", "application": "0.1",
        "revision": "0001", "recordings": False,
        "files": {"observer.sqlite": {"size": 4, "sha256": "0" * 64}},
    }  # fmt: skip
    text = data.draw(damaged([json.dumps(whole).encode()], (b"null", b"[]", b"{}", b'"\\u0000"')))
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("manifest.json", text)
        archive.writestr("observer.sqlite", b"rows")
    path = folder / "listed"
    path.write_bytes(file.getvalue())
    read_or_refused(lambda: restored(path), BackupError)

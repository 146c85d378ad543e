"""Archive of many files, a zip or a tar, streamed in both directions, with every byte checked.

``manifest.json`` names each file with its size and SHA-256; it is written last.
"""

from __future__ import annotations

import hashlib
import io
import json
import shutil
import tarfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath
from typing import IO

from app.contract.values import JsonObject
from observer.errors import InputError
from observer.whole_files import whole_file

KIND = "dynamic-observer backup"
VERSION = 1
_MANIFEST = "manifest.json"
_COMMAND = "dynamic-observer backup"
_CHUNK = 1024 * 1024
_LARGEST_MANIFEST = 64 * _CHUNK
# Endings of files that are compressed already, or too large to compress.
_STORED = (".mcap", ".mp4", ".zip", ".jpg", ".png")


# zlib.error and RuntimeError (a password) come from a zip's content, ValueError (invalid text or
# offsets) and OverflowError from the headers of both.
_BROKEN = (
    zipfile.BadZipFile, tarfile.TarError, EOFError, OSError, NotImplementedError, RuntimeError,
    zlib.error, ValueError, OverflowError,
)  # fmt: skip


class BackupError(InputError):
    """Failure to write a backup, or to restore it as it is."""


@dataclass(frozen=True)
class Entry:
    """File in a backup. ``size`` in bytes."""

    size: int
    sha256: str


@dataclass(frozen=True)
class Manifest:
    """Contents of a backup.

    Attributes:
        made_at: UTC. application: the version that made it. revision: revision of its database.
        recordings: whether it includes runs' recordings.
        files: by name, relative to the data folder.
    """

    made_at: str
    application: str
    revision: str
    recordings: bool
    files: dict[str, Entry] = field(default_factory=dict)


class BundleWriter:
    """Writer that adds files; ``finish`` writes the manifest. See ``bundle_writer``."""

    def __init__(self, archive: zipfile.ZipFile | tarfile.TarFile) -> None:
        self._archive = archive
        self.files: dict[str, Entry] = {}

    def add(self, name: str, file: Path) -> int:
        """Add the present content of a file and return its bytes; later appends are left out."""
        with file.open("rb") as opened:
            self.files[name] = self._write(name, opened, file.stat().st_size)
        return self.files[name].size

    def finish(self, manifest: Manifest) -> None:
        content = {"kind": KIND, "version": VERSION, **asdict(manifest)}
        text = json.dumps(content, indent=1).encode()
        self._write(_MANIFEST, io.BytesIO(text), len(text))

    def _write(self, name: str, source: IO[bytes], size: int) -> Entry:
        stream = _Counted(source, size)
        if isinstance(self._archive, zipfile.ZipFile):
            info = zipfile.ZipInfo(name)
            if PurePosixPath(name).suffix not in _STORED:
                info.compress_type = zipfile.ZIP_DEFLATED
            with self._archive.open(info, "w", force_zip64=True) as target:
                shutil.copyfileobj(stream, target, _CHUNK)
        else:
            member = tarfile.TarInfo(name)
            member.size, member.mode = size, 0o600
            self._archive.addfile(member, stream)
        if stream.left:
            raise OSError(0, "a file was truncated while it was copied")
        return Entry(size, stream.hash.hexdigest())


@contextmanager
def bundle_writer(path: Path) -> Iterator[BundleWriter]:
    """Write ``path`` as a zip or a tar, by its extension, completely or not at all.

    Raises:
        BackupError: the extension is another one, or the file cannot be written.
    """
    if path.suffix not in (".zip", ".tar"):
        raise BackupError(f"a backup file must end in .zip or .tar, not {path.name}")
    try:
        with whole_file(path) as part:
            archive: zipfile.ZipFile | tarfile.TarFile
            if path.suffix == ".zip":
                archive = zipfile.ZipFile(part, "w")
            else:
                archive = tarfile.TarFile(part, "w", format=tarfile.PAX_FORMAT)
            with archive:
                yield BundleWriter(archive)
    except OSError as error:
        raise BackupError(
            f"cannot write {path} ({error.strerror or error}); name a file in an existing folder "
            "with enough space"
        ) from error


class _Counted:
    """Reader of exactly ``size`` bytes of a stream that hashes them on the way."""

    def __init__(self, stream: IO[bytes], size: int) -> None:
        self._stream = stream
        self.left = size
        self.hash = hashlib.sha256()

    def read(self, size: int = -1) -> bytes:
        wanted = self.left if size < 0 else min(size, self.left)
        chunk = self._stream.read(wanted)
        self.left -= len(chunk)
        self.hash.update(chunk)
        return chunk


class Bundle:
    """Backup open for reading; its manifest is checked against its contents."""

    def __init__(self, path: Path, archive: zipfile.ZipFile | tarfile.TarFile) -> None:
        self._path = path
        self._archive = archive
        names = self._names()
        self.manifest = self._read_manifest(names)
        listed = {_MANIFEST, *self.manifest.files}
        if len(names) != len(set(names)) or set(names) != listed:
            raise self._broken("its files do not match its list of files")

    def extract(self, name: str, target: Path) -> None:
        """Extract one file and check it.

        Raises:
            BackupError: the file does not match the manifest. OSError: it cannot be written.
        """
        target.parent.mkdir(parents=True, exist_ok=True)
        with target.open("wb") as sink:
            for chunk in self._chunks(name):
                sink.write(chunk)

    def _chunks(self, name: str) -> Iterator[bytes]:
        """Yield a file's content; raise BackupError if it does not match the manifest."""
        entry = self.manifest.files[name]
        # Errors of writing the chunks are not raised in here.
        try:
            with self._open(name) as source:
                stream = _Counted(source, entry.size)
                while chunk := stream.read(_CHUNK):
                    yield chunk
                whole = stream.left == 0 and not source.read(1)
        except _BROKEN as error:
            raise self._broken(f"{name} cannot be read") from error
        if not whole or stream.hash.hexdigest() != entry.sha256:
            raise self._broken(f"{name} has a wrong checksum")

    def _names(self) -> list[str]:
        if isinstance(self._archive, zipfile.ZipFile):
            return self._archive.namelist()
        try:
            members = self._archive.getmembers()
        except _BROKEN as error:
            raise self._broken("its files cannot be listed") from error
        if not all(member.isreg() for member in members):
            raise self._broken("it contains entries other than files")
        return [member.name for member in members]

    def _open(self, name: str) -> IO[bytes]:
        if isinstance(self._archive, zipfile.ZipFile):
            return self._archive.open(name)
        opened = self._archive.extractfile(name)
        assert opened is not None
        return opened

    def _read_manifest(self, names: list[str]) -> Manifest:
        if _MANIFEST not in names:
            raise BackupError(f"{self._path} is not a backup made by {_COMMAND}")
        try:
            with self._open(_MANIFEST) as opened:
                content: JsonObject = json.loads(opened.read(_LARGEST_MANIFEST))
            kind, version = content.pop("kind"), content.pop("version")
            if kind == KIND and version != VERSION:
                raise BackupError(
                    f"{self._path} was made by a newer version of dynamic-observer; upgrade it"
                )
            files = {name: Entry(**entry) for name, entry in content.pop("files").items()}
            manifest = Manifest(**content, files=files)
        except (*_BROKEN, KeyError, TypeError, AttributeError) as error:
            raise self._broken("its list of files cannot be read") from error
        if kind != KIND:
            raise BackupError(f"{self._path} is not a backup made by {_COMMAND}")
        for name, entry in files.items():
            if not isinstance(entry.size, int) or entry.size < 0 or not _is_safe(name):
                raise self._broken("its list of files has an unexpected format")
        return manifest

    def _broken(self, why: str) -> BackupError:
        return BackupError(f"the backup {self._path} is damaged ({why}); use another one")


def _is_safe(name: str) -> bool:
    """Return whether the name is a plain relative path, valid on every system."""
    parts = name.split("/")
    return all(part not in ("", ".", "..") and "\\" not in part for part in parts) and (
        "\0" not in name and ":" not in parts[0]
    )


@contextmanager
def open_bundle(path: Path) -> Iterator[Bundle]:
    """Open a backup, whatever its name.

    Raises:
        BackupError: the file is missing, is not a backup, or is damaged.
    """
    try:
        if zipfile.is_zipfile(path):
            archive: zipfile.ZipFile | tarfile.TarFile = zipfile.ZipFile(path)
        else:
            archive = tarfile.TarFile(path, "r")
    except tarfile.TarError as error:
        raise BackupError(
            f"{path} is not a backup or is incomplete; {_COMMAND} makes one"
        ) from error
    except _BROKEN as error:
        why = getattr(error, "strerror", None) or error
        raise BackupError(f"cannot read the backup {path} ({why}); name a backup") from error
    with archive:
        yield Bundle(path, archive)

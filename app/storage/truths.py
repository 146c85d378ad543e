"""Ground-truth files, identified by content: facts in the database, files in the data folder."""

from __future__ import annotations

import hashlib
import re
import shutil
from pathlib import Path

from sqlalchemy import select

from app.contract.values import JsonObject, filled, known
from app.storage.database import Database
from app.storage.errors import StorageError, StorageFull, StorageMissing
from app.storage.models import Run, Truth
from app.storage.records import TruthRecord, utc_now
from observer.whole_files import NO_SPACE, whole_file

_ENDING = re.compile(r"\.[0-9A-Za-z]{1,8}")


class TruthTables(Database):
    """Table of truth files. Their format is not known here: ``observer.truth.files`` reads them."""

    def save_truth(
        self, file: Path, *, name: str, format: str, info: JsonObject | None = None
    ) -> TruthRecord:
        """Store a copy of a truth file; an existing one with the same content takes the new name
        and facts.

        Raises:
            StorageFull: there is no space for the copy. StorageError: it cannot be written.
        """
        ending = _ENDING.fullmatch(Path(name).suffix)
        key, stored = self._keep(file, ending.group().lower() if ending else "")
        with self._writing() as session:
            row = session.get(Truth, key)
            if row is None:
                row = Truth(id=key, created_at=utc_now())
                session.add(row)
            row.name, row.format, row.info, row.listed = name, format, dict(info or {}), True
            row.file = stored.name
            return filled(TruthRecord, row)

    def get_truth(self, id: str) -> TruthRecord | None:
        """Return one truth, including deleted ones that a run refers to."""
        with self._reading() as session:
            return known(TruthRecord, session.get(Truth, id))

    def truth_file(self, id: str) -> Path:
        """Return the path of the truth's file.

        Raises:
            StorageMissing: there is no such truth, or its file is gone.
        """
        record = self.get_truth(id)
        if record is None:
            raise StorageMissing(f"there is no ground truth {id}; upload it first")
        path = self.folder.truth(record.file)
        if not path.is_file():
            raise StorageMissing(
                f"the file {path} of the ground truth {record.name} is missing; upload it again"
            )
        return path

    def list_truths(self) -> list[TruthRecord]:
        """Return the listed truths, newest first."""
        query = select(Truth).where(Truth.listed).order_by(Truth.created_at.desc(), Truth.id)
        with self._reading() as session:
            return [filled(TruthRecord, row) for row in session.scalars(query)]

    def delete_truth(self, id: str) -> bool:
        """Remove it from the list (False if absent), and its file unless a run needs it."""
        with self._writing() as session:
            row = session.get(Truth, id)
            if row is None or not row.listed:
                return False
            row.listed = False
            used = session.scalar(select(Run.id).where(Run.truth_id == id).limit(1))
            unused = None if used else row.file
            if unused is not None:
                session.delete(row)
        if unused is not None:
            self.folder.truth(unused).unlink(missing_ok=True)
        return True

    def purge_truths(self) -> None:
        """Delete unlisted truths that no run needs any more."""
        needed = select(Run).where(Run.truth_id == Truth.id).exists()
        query = select(Truth).where(~Truth.listed, ~needed)
        with self._writing() as session:
            rows = list(session.scalars(query))
            files = [row.file for row in rows]
            for row in rows:
                session.delete(row)
        for file in files:
            self.folder.truth(file).unlink(missing_ok=True)

    def _keep(self, file: Path, ending: str) -> tuple[str, Path]:
        folder = self.folder.truth("")
        try:
            with file.open("rb") as source:
                key = hashlib.file_digest(source, "sha256").hexdigest()
            known = self.get_truth(key)
            kept = folder / (f"{key}{ending}" if known is None else known.file)
            folder.mkdir(parents=True, exist_ok=True)
            with whole_file(kept, durable=True) as part:
                shutil.copyfile(file, part)
        except OSError as error:
            kind = StorageFull if error.errno in NO_SPACE else StorageError
            raise kind(
                f"the ground truth cannot be stored in {folder} ({error.strerror}); free some disk "
                "space or make the folder writable"
            ) from error
        return key, kept

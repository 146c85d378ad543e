"""Storage of the rig, ``rig.yaml`` in the data folder, and its changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from app.contract.rig import RigNumber
from app.server.data_files import storage_errors, write_whole
from app.server.errors import FieldError
from app.settings import RIG_FILE
from observer.errors import InputError
from observer.rig.rig import MOUNT_KEYS, Rig, RigMount, RigValue, RobotModel, Role
from observer.rig.rig_file import read_rig, rig_text
from observer.robot_opening import check_port
from observer.robots.ports import shown_port


class RigStore:
    """Reader and writer of the rig's file; the caller ensures one change at a time.

    Attributes:
        path: path of the file; None keeps the rig in memory only.
        rig: the current rig.
    """

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.rig = Rig()

    def load(self) -> str | None:
        """Read the file, if any; return a warning if it could not be used.

        An unreadable file stays unchanged until somebody saves a rig.
        """
        if self.path is None:
            return None
        try:
            self.rig = read_rig(self.path.read_text(encoding="utf-8"), self.path.name)
        except FileNotFoundError:
            return None
        except (OSError, UnicodeDecodeError) as error:
            return f"the rig is unknown, because {self.path} cannot be read: {error}"
        except InputError as error:
            return f"the rig is unknown: {error}"
        return None

    @property
    def text(self) -> str:
        """Return the rig as stored in the file, including the keys in ports."""
        return rig_text(self.rig)

    @property
    def observed_text(self) -> str:
        """Return ``text`` without the ports and their keys, which do not concern observing."""
        return text_without_ports(self.rig)

    def keep(self, rig: Rig) -> None:
        """Make a rig the current one and write it to the file, which is replaced as a whole.

        Raises:
            FieldError, StorageFull: the file cannot be written; the old rig remains current.
        """
        if self.path is not None:
            with storage_errors(self.path):
                _keep_unreadable(self.path)
            write_whole(self.path, rig_text(rig))
        self.rig = rig

    def changed(
        self,
        mount: Mapping[str, RigNumber | None],
        models: Mapping[Role, RobotModel | None] | None,
        *,
        for_simulated: bool,
        calibration: str | None,
    ) -> Rig:
        """Return the rig with the changes of a request; mocap bodies stay the same.

        Args:
            mount: values by key, None if unknown.
            models: robot models by role, None if unknown; None: unchanged.
            calibration: calibration in use while the mount was measured.

        Raises:
            FieldError: a value is out of its range.
        """
        try:
            values = {key: RigValue(n.value, n.sigma) for key, n in mount.items() if n is not None}
            known = self.rig.models if models is None else models
            return replace(
                self.rig,
                mount=RigMount(**values),
                models={role: model for role, model in known.items() if model is not None},
                for_simulated=for_simulated,
                calibration=calibration,
            )
        except InputError as error:
            sentence = str(error)
            key = next((key for key in MOUNT_KEYS if sentence.startswith(key)), "mount")
            raise FieldError(("body", "mount", key), sentence) from error

    def with_port(self, role: Role, port: str, model: RobotModel | None) -> Rig:
        """Return the rig with a robot's port and model changed.

        With model None the robot reports its model. A port given in its displayed form keeps its
        hidden key.

        Raises:
            FieldError: the text names no port.
        """
        before = self.rig.ports.get(role)
        if before is not None and port == shown_port(before):
            port = before
        ports: dict[Role, str] = {**self.rig.ports, role: port}
        models = {each: m for each, m in self.rig.models.items() if each != role}
        try:
            check_port(port)
            if model is not None:
                models[role] = model
            return replace(self.rig, ports=ports, models=models)
        except InputError as error:
            raise FieldError(("body", "port"), str(error)) from error

    def without_port(self, role: Role) -> Rig:
        """Return the rig without a robot's port; the model stays."""
        ports = {each: port for each, port in self.rig.ports.items() if each != role}
        return replace(self.rig, ports=ports)

    def observes_alike(self, rig: Rig) -> bool:
        """Return whether a source would be observed in the same way with the given rig."""
        return _as_observed(rig) == _as_observed(self.rig)

    def parsed(self, text: str) -> Rig:
        """Parse an uploaded rig file.

        Raises:
            FieldError: it cannot be used; one sentence says why.
        """
        try:
            return read_rig(text, RIG_FILE)
        except InputError as error:
            raise FieldError(("body", "text"), str(error)) from error


def text_without_ports(rig: Rig) -> str:
    """Return a rig in the format of its file, without ports, which may contain keys."""
    return rig_text(replace(rig, ports={}))


def _as_observed(rig: Rig) -> str:
    # The robots and their ports do not affect what is observed.
    return text_without_ports(replace(rig, models={}))


def _keep_unreadable(path: Path) -> None:
    """Move an unreadable file aside instead of overwriting it: somebody wrote it."""
    try:
        read_rig(path.read_text(encoding="utf-8"), path.name)
    except FileNotFoundError:
        return
    except (InputError, UnicodeDecodeError):
        aside = path.with_name(f"{path.name}.unreadable")
        number = 1
        # Do not overwrite a file moved aside earlier: it is somebody's work as well.
        while aside.exists():
            number += 1
            aside = path.with_name(f"{path.name}.unreadable-{number}")
        path.replace(aside)

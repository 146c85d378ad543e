"""The rig's file: written whole, and never overwritten if someone wrote it by hand."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from app.contract.rig import RigNumber
from app.server.errors import FieldError
from app.server.rig.store import RigStore
from app.storage import StorageFull
from observer.geometry import Pose
from observer.rig.rig import LIMITS, Rig, RigMount, RigValue
from observer.rig.rig_file import read_rig
from observer.whole_files import NO_SPACE

FULL = Rig(
    mount=RigMount(height_m=RigValue(0.4), tilt_deg=RigValue(5.0, 0.2)),
    T_body_base={"P3-DX": Pose(np.eye(3), np.array([0.1, 0.0, -0.2]))},
    models={"observer": "p3dx-sh"},
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "data" / "rig.yaml"


def loaded(path: Path | None) -> RigStore:
    store = RigStore(path)
    assert store.load() is None
    return store


def test_a_saved_rig_is_loaded_again(path: Path) -> None:
    store = loaded(path)
    assert store.rig.mount.values() == {}
    store.keep(FULL)
    again = loaded(path)
    assert again.text == store.text == path.read_text()
    assert again.rig.mount == FULL.mount
    assert dict(again.rig.models) == {"observer": "p3dx-sh"}
    assert np.allclose(again.rig.T_body_base["P3-DX"].translation, [0.1, 0, -0.2])
    assert [each.name for each in path.parent.iterdir()] == ["rig.yaml"]


def test_without_a_file_the_rig_is_kept_in_memory() -> None:
    store = loaded(None)
    store.keep(FULL)
    assert store.rig is FULL


@pytest.mark.parametrize(
    "content",
    [b"mount: {height_m: 9}\n", b"mount: [", b"\xff\xfe\x00", b"a: &a [1]\nb: *a\n", b"x: 1\n"],
)
def test_an_unreadable_file_is_reported_and_moved_aside_on_save(path: Path, content: bytes) -> None:
    path.parent.mkdir()
    path.write_bytes(content)
    store = RigStore(path)
    assert "the rig is unknown" in (store.load() or "")
    # It stays in place until a rig is saved.
    assert path.read_bytes() == content
    store.keep(FULL)
    assert path.with_name("rig.yaml.unreadable").read_bytes() == content
    assert loaded(path).rig.mount == FULL.mount
    # The next unreadable file does not replace it.
    path.write_bytes(b"mount: 7\n")
    store.keep(Rig())
    assert path.with_name("rig.yaml.unreadable").read_bytes() == content
    assert path.with_name("rig.yaml.unreadable-2").read_bytes() == b"mount: 7\n"
    # A readable file is just the old rig: it is replaced.
    store.keep(FULL)
    assert len(list(path.parent.iterdir())) == 3


def test_a_folder_in_place_of_the_file_is_refused_and_the_old_rig_stays(path: Path) -> None:
    path.mkdir(parents=True)
    store = RigStore(path)
    assert "cannot be read" in (store.load() or "")
    with pytest.raises(FieldError, match="cannot be written"):
        store.keep(FULL)
    assert store.rig is not FULL


@pytest.mark.parametrize("cause", sorted(NO_SPACE))
def test_a_full_disk_leaves_the_old_file_intact(
    path: Path, monkeypatch: pytest.MonkeyPatch, cause: int
) -> None:
    store = loaded(path)
    store.keep(FULL)
    before = path.read_text()

    def full(_: int) -> None:
        raise OSError(cause, os.strerror(cause))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StorageFull, match="no space is left to write"):
        store.keep(Rig())
    assert path.read_text() == before
    assert store.rig is FULL
    assert [each.name for each in path.parent.iterdir()] == ["rig.yaml"]


def test_a_change_keeps_values_it_does_not_name(path: Path) -> None:
    store = loaded(path)
    store.keep(FULL)
    rig = store.changed(
        {"height_m": RigNumber(0.5, 0.01), "tilt_deg": None},
        None,
        for_simulated=True,
        calibration="abc",
    )
    assert rig.mount.height_m == RigValue(0.5, 0.01)
    assert rig.mount.tilt_deg is None
    assert dict(rig.models) == {"observer": "p3dx-sh"}
    assert set(rig.T_body_base) == {"P3-DX"}
    assert (rig.for_simulated, rig.calibration) == (True, "abc")
    none = store.changed({}, {}, for_simulated=False, calibration=None)
    assert dict(none.models) == {}
    # Changes are not in force before they are saved.
    assert store.rig is FULL


@pytest.mark.parametrize("key", LIMITS)
def test_a_value_out_of_range_names_its_key(key: str) -> None:
    low, high = LIMITS[key]
    for value in (low - 0.01, high + 0.01):
        with pytest.raises(FieldError, match=f"^{key} must be between") as refused:
            RigStore(None).changed(
                {key: RigNumber(value)}, None, for_simulated=False, calibration=None
            )
        assert refused.value.field == ("body", "mount", key)
    for value in (low, high):
        given = {key: RigNumber(value)}
        rig = RigStore(None).changed(given, None, for_simulated=False, calibration=None)
        assert rig.mount.values()[key].value == value


def test_an_uploaded_file_is_parsed_or_refused() -> None:
    store = RigStore(None)
    store.keep(FULL)
    parsed = store.parsed(store.text)
    assert parsed.mount == FULL.mount
    assert read_rig(store.text, "it").mount == FULL.mount
    with pytest.raises(FieldError, match=r"rig.yaml: .*height") as refused:
        store.parsed("mount: {height: 3}\n")
    assert refused.value.field == ("body", "text")

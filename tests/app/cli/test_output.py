from pathlib import Path

import pytest

from app.cli.output import whole_text
from observer.errors import InputError


def test_a_result_appears_under_its_name_only_when_complete(tmp_path: Path) -> None:
    path = tmp_path / "tracks.jsonl"
    with whole_text(path) as file:
        file.write("one\n")
        assert not path.exists()
    assert path.read_text() == "one\n"
    assert list(tmp_path.iterdir()) == [path]


def test_a_failed_write_keeps_the_earlier_result_and_the_partial_one(
    tmp_path: Path,
) -> None:
    path = tmp_path / "tracks.jsonl"
    path.write_text("earlier\n")

    def write_half() -> None:
        with whole_text(path) as file:
            file.write("half\n")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write_half()
    assert path.read_text() == "earlier\n"
    assert (tmp_path / "tracks.jsonl.part").read_text() == "half\n"


def test_a_folder_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match="nowhere"),
        whole_text(tmp_path / "nowhere" / "tracks.jsonl"),
    ):
        pass


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_full_disk_is_reported_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "tracks.jsonl.part").symlink_to("/dev/full")
    with (
        pytest.raises(InputError, match=r"cannot write .*tracks\.jsonl: No space left"),
        whole_text(tmp_path / "tracks.jsonl") as file,
    ):
        file.write("one\n")


def test_a_folder_in_place_of_the_file_is_reported_and_the_result_kept(tmp_path: Path) -> None:
    (tmp_path / "tracks.jsonl").mkdir()
    with (
        pytest.raises(InputError, match=r"cannot write .*tracks\.jsonl: Is a directory"),
        whole_text(tmp_path / "tracks.jsonl") as file,
    ):
        file.write("one\n")
    assert (tmp_path / "tracks.jsonl.part").read_text() == "one\n"


def test_the_current_folder_in_place_of_a_file_is_reported() -> None:
    with pytest.raises(InputError, match=r"cannot write \.: Is a directory"), whole_text(Path()):
        pass


def test_another_error_of_the_block_is_not_reported_as_the_file_s(tmp_path: Path) -> None:
    with (
        pytest.raises(PermissionError, match="camera"),
        whole_text(tmp_path / "tracks.jsonl"),
    ):
        raise PermissionError(13, "the camera is busy")

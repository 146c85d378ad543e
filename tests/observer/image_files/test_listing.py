"""Order of image files."""

from __future__ import annotations

from observer.image_files.listing import natural_order


def test_numbers_in_names_are_sorted_as_numbers_however_long() -> None:
    longest = "9" * 5000
    names = ["0.png", "a2.png", "a10.png", "2.png", "02b.png", "10.png", f"{longest}.png"]
    assert sorted(set(names), key=natural_order) == names

"""The worker makes pictures of scenarios and of folders, or says why it cannot."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from app.runtime.worker import JobFailed
from app.workers.thumbnails.messages import Picture
from app.workers.thumbnails.process import picture
from app.workers.thumbnails.work import HEIGHT, WIDTH, do_job
from observer.simulation.export import export_stereo_folder


def decoded(jpeg: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return np.asarray(image)


async def test_a_process_makes_the_picture_or_states_the_reason() -> None:
    made = decoded(await picture("simulated:lab"))
    assert made.shape == (HEIGHT, WIDTH, 3)
    assert made.std() > 20
    with pytest.raises(JobFailed, match="no scenario"):
        await picture("simulated:nonsense")


def test_a_folder_shows_its_first_image(tmp_path: Path) -> None:
    export_stereo_folder("lab", 0, tmp_path / "lab", frames=2)
    left = cv2.imread(str(sorted((tmp_path / "lab" / "left").iterdir())[0]))
    made = decoded(do_job(Picture(str(tmp_path / "lab")), lambda *_: None).jpeg)
    small = cv2.resize(left, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    assert np.abs(made.astype(float) - small).mean() < 5


def test_images_of_another_shape_are_cropped_to_the_same_size() -> None:
    made = decoded(do_job(Picture("simulated:calibration"), lambda *_: None).jpeg)
    assert made.shape == (HEIGHT, WIDTH, 3)

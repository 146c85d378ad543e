"""The worker's side: opens a source, takes one left image and makes it small."""

from __future__ import annotations

import cv2
import numpy as np

from app.runtime.jobs import Report
from app.workers.thumbnails.messages import Picture, Pictured
from observer.errors import SourceError
from observer.image_files.jpeg import encode_jpeg
from observer.opening import open_source
from observer.simulation.source import SimulatedSource
from observer.types import Image, StereoFrame

# Twice the tile's size, for screens with more than one pixel per CSS pixel.
WIDTH, HEIGHT = 256, 128
_QUALITY = 80
# Reads attempted before giving up on a source without readable frames.
_TRIES = 10


def do_job(job: Picture, _: Report) -> Pictured:
    """Make the picture.

    Raises:
        DynamicObserverError: the source cannot be opened, or no frame of it can be read.
    """
    return Pictured(encode_jpeg(_small(_image(job.spec)), _QUALITY))


def _image(spec: str) -> Image:
    source = open_source(spec).source
    try:
        if isinstance(source, SimulatedSource):
            return source.still()
        for _ in range(_TRIES):
            frame = source.read()
            if isinstance(frame, StereoFrame):
                return frame.left
    finally:
        source.close()
    raise SourceError(f"no frame of {spec[:80]} can be read")


def _small(image: Image) -> Image:
    """Return the middle of the image, (HEIGHT, WIDTH)."""
    height, width = image.shape[:2]
    scale = max(WIDTH / width, HEIGHT / height)
    size = max(WIDTH, round(width * scale)), max(HEIGHT, round(height * scale))
    scaled = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    top, left = (size[1] - HEIGHT) // 2, (size[0] - WIDTH) // 2
    return np.asarray(scaled[top : top + HEIGHT, left : left + WIDTH], np.uint8)

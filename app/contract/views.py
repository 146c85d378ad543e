"""Views that a person can watch; each is a slot of shared memory, not a message."""

from __future__ import annotations

from typing import TypedDict

# Views that a person can watch; each is one slot of JPEG bytes.
#   left      rectified left image, green star features, flow vectors, the obstacles' silhouettes
#             and boxes
#   warped    the image of t+dt transformed into the frame of t
#   disparity disparity as colours, nothing where it is unknown
#   residual  residual flow as arrows and colours over the darkened image
#   plain     the rectified left image as it is (camera frustum in the 3D scene)
#   camera_left, camera_right  each image as taken; while calibrating with the board in it
CAMERA_NAMES: tuple[str, str] = ("camera_left", "camera_right")
VIEW_NAMES: tuple[str, ...] = (
    "left",
    "warped",
    "disparity",
    "residual",
    "plain",
    *CAMERA_NAMES,
)
# The view that needs dense stereo, like the cloud.
DISPARITY_NAME = "disparity"
# The slot of the dense cloud; watched like a view.
CLOUD_NAME = "cloud"


class ViewHeader(TypedDict):
    """Facts of a view's frame, on the source's clock and the host's monotonic one; its size, px."""

    frame: int
    time: float
    received: float
    width: int
    height: int


class FrameInstant(TypedDict):
    """Facts of a frame; ``T_world_camera`` as 16 numbers by rows, None where it is unknown."""

    frame: int
    time: float
    received: float
    segment: int
    T_world_camera: list[float] | None


class CloudHeader(FrameInstant):
    """Facts of the cloud's frame, the number of points, and the downscaling factor for matching.

    The payload is points (N, 3) float32, metres, in the camera frame, then colours (N, 3) uint8
    RGB: those of the image, mixed on obstacles with the colours of their states.
    """

    count: int
    coarseness: int

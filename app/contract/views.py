"""Views that a person can watch; each is a slot of shared memory, not a message."""

from __future__ import annotations

# Views that a person can watch; each is one slot of JPEG bytes.
#   left      rectified left image, green star features, flow vectors, yellow obstacle rectangles
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

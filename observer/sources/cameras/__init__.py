"""Live cameras as sources: V4L2 devices, side-by-side devices and network cameras."""

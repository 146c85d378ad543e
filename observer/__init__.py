"""Seeing moving obstacles from a moving stereo camera: the library.

Frames (``T_target_source`` maps source coordinates into the target frame):

=========  =====================================================================
camera     rectified left camera's optical frame: x right, y down, z forward
base       the robot: x forward, y left, z up (REP-103)
world      the camera frame at a segment's first valid pose; obstacles live here
image      pixels: u right, v down, the upper left pixel's centre is (0, 0)
=========  =====================================================================

Units: metres, seconds, radians, pixels, m/s. ``time`` is the exposure on the source's own clock,
``received`` the host's monotonic clock.
"""

"""Vision stages and checks that the methods share, each once.

- The pair: ``rectification``, ``view``, ``stereo`` (dense), ``sparse_stereo`` (at new points).
- Points: ``features``, ``surf``, ``keypoints`` (which to track), ``klt_tracking``,
  ``neighbourhoods``.
- The camera's motion: ``rigid_ego_motion``, ``wheel_odometry``, ``motion_gate``, ``camera_rate``.
- What is wrong with the images: ``image_health``, of ``image_checks``, ``epipolar_error``,
  ``mismatch``, ``swapped`` and ``flicker``.
- What is wrong with the calibration or the exposures: ``disparity_bias``, ``vergence_fit``,
  ``exposure_skew``.
- Tracks: ``lifecycle`` (states and ids), ``kinematics`` (what is derived of their velocity).
"""

"""Sources of stereo frames."""

"""Where stereo frames come from."""

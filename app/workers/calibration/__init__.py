"""A process that computes one calibration and leaves.

Apart from the server, because it takes seconds of full work, decodes images that somebody sent
in, and is cancelled by ending it: no step inside OpenCV can be interrupted.
"""

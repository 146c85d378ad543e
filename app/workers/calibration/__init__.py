"""Process that computes one calibration and exits.

It is separate from the server because it takes seconds of full CPU load, decodes uploaded images,
and is cancelled by ending it: no step inside OpenCV can be interrupted.
"""

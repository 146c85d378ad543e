"""Cameras under Video4Linux: their properties and controls. Images are read by OpenCV, not here."""

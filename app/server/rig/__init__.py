"""Pose of the camera on its robot: editing and estimation."""

"""The rig: how the cameras sit on the robot, typed in by a person or estimated, and its file."""

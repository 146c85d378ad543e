"""The rig: how the cameras are mounted on the robot, entered or estimated, and its file."""

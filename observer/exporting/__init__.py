"""Export of a run as files for other tools: tables, video, point clouds, ROS 2 bags."""

"""Export of a run to files for other tools: tables, video, point clouds, ROS 2 bags."""

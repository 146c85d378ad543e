"""The monocular method: depth by travel, scale by the ground plane and odometry."""

"""The monocular method: depth from motion, scale from the ground plane and odometry."""

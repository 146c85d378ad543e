"""What one camera goes by: lines of sight, depth by travel, the ground, what keeps its metres."""

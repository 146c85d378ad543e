"""What one camera goes by: lines of sight, depth by travel, the floor, what keeps its metres."""

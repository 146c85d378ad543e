"""What happened in a run, as one MCAP file that people's own tools open."""

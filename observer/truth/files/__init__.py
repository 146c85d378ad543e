"""Motion capture from files: a reader for each format, and one that detects the format."""

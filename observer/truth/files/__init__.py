"""Motion capture from files: one reader for each format, and one that finds out which it is."""

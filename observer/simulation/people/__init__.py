"""People who walk, stand and wave in the simulated lab."""

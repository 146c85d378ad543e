"""The simulated lab: a world, its rendering, its source and its ground truth."""

"""Ground truth: what really moved, for comparison only."""

"""What really moved, for comparison only."""

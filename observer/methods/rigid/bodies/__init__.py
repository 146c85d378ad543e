"""What an obstacle is over time: how it moves and turns, its box, its points and its number."""

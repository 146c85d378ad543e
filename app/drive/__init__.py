"""Drive process: sole writer of both robots, with the guard inside it."""

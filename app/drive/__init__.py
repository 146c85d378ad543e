"""Drive process: the only one that commands the robots; the guard runs inside it."""

"""Vision stages and checks that the methods share."""

"""Build of the project from a clone; none of it is in the wheel."""

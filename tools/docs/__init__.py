"""Build of the documentation; none of it is in the wheel."""

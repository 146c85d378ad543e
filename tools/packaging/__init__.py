"""How the project is built from a clone; none of it is in the wheel."""

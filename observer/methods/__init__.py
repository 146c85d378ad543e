"""Methods that find moving obstacles: one package each, and their common interface."""

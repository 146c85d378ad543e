"""How good the observer is, against truth."""

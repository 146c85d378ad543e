"""Painters: every texture of the lab is computed from a seed when first needed."""

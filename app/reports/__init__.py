"""Figures and tables of the paper, redone from the recording of a run."""

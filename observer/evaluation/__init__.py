"""Evaluation of the observer against ground truth."""

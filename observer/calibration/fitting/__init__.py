"""The fit of both cameras to views of a board, and how well the views determine it.

``fit`` reads as the whole: ``initialization``, ``adjustment``, ``outlier_views``, ``uncertainty``.
"""

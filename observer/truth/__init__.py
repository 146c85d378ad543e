"""Ground truth: what really moved, for comparison only.

``contract`` says what a truth answers. ``sampled`` interpolates it, ``csv_file`` reads
``truth.csv``; ``files`` and ``live`` read motion capture, which ``alignment`` brings into a run's
clock and world.
``matching`` pairs true bodies with reported obstacles, frame by frame.
"""

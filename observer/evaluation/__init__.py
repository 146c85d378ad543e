"""Evaluation of the observer against ground truth.

- One run: ``lines`` reads what was observed, ``tally`` compares it frame by frame, ``evaluate``
  makes figures of the counts, ``breakdown`` and ``speed_errors`` divide them.
- ``benchmark``: presets over the scenarios of ``sources`` (``source_run``, ``jobs``), its
  ``results``, their ``report`` and ``figure``, and the ``targets`` that they must reach.
- ``calibration_accuracy``: the calibration itself, with a board in known cameras.
- ``sweep``: combinations of parameters; ``navigation``: drives among people.
"""

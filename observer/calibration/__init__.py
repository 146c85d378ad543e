"""Calibrations: boards, the fit, how good it is, and how it ages.

``boards`` finds boards in images, ``fitting`` fits a pair of cameras to them; ``verdict`` says in
metres and m/s what the fitted rig is good for, ``tape`` compares its depth with a tape measure.
``ageing`` watches a calibration during runs. ``formats`` has one reader for each file format and,
where other programs read it too, one writer.
"""

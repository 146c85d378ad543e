"""Whole stages as compiled loops over plain arrays; ``compiled`` says how and why.

Each function here has an oracle in ``tests/observer/kernels/oracles``, the same formulas in numpy.
Kernels avoid ``np.linalg``, ``@`` and slices: written-out loops compile in a fraction of the time.
"""

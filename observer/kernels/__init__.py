"""Whole stages as compiled loops over plain arrays; ``compiled`` says how and why.

Each function here has an oracle in ``tests/observer/kernels/oracles``, the same formulas by numpy.
No ``np.linalg``, ``@`` or slices inside: written out they compile in a fraction of the time.
"""

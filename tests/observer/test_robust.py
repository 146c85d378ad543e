"""The median equals numpy's for all values."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from observer.robust import median


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int16])
@given(data=st.data())
def test_median_matches_numpy(dtype: type[np.generic], data: st.DataObject) -> None:
    values = data.draw(arrays(dtype, st.integers(1, 40)))
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        values = np.nan_to_num(values, posinf=1e30, neginf=-1e30)
    with np.errstate(over="ignore"):
        assert median(values) == pytest.approx(np.median(values), rel=1e-6)

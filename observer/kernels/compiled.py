"""Declaration of kernels, which numba compiles.

A frame needs thousands of operations on arrays of a few hundred points, whose overhead in numpy is
many times the arithmetic. A kernel is such a stage written as one loop: plain Python over arrays
and numbers that numba compiles to machine code, which runs without the interpreter and its lock.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Final, Generic, ParamSpec, TypeVar, cast

import numba
import numpy as np
from numba.core import types
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from observer.kernels.cache import KernelCache

P = ParamSpec("P")
R = TypeVar("R")


def array(dtype: types.Type, dimensions: int) -> types.Array:
    """Return the type of a contiguous array that a kernel only reads; read-only arrays fit too."""
    return types.Array(dtype, dimensions, "C", readonly=True)


# Types of arguments: numbers, and arrays by their number of dimensions.
REAL: Final = types.float64
SINGLE: Final = types.float32
WHOLE: Final = types.int64
REALS1, REALS2, REALS3 = (array(types.float64, n) for n in (1, 2, 3))
WHOLES1, WHOLES2 = (array(types.int64, n) for n in (1, 2))
FLAGS1, FLAGS2 = (array(types.boolean, n) for n in (1, 2))
SINGLES1, SINGLES2 = (array(types.float32, n) for n in (1, 2))
INTS2: Final = array(types.int32, 2)
SHORTS2: Final = array(types.int16, 2)
BYTES1, BYTES2 = (array(types.uint8, n) for n in (1, 2))
PAIR: Final = types.UniTuple(types.float64, 2)
# Focal lengths and principal point, pixels, and baseline, metres: fx, fy, cx, cy, baseline.
CAMERA: Final = types.UniTuple(types.float64, 5)

# The same types for the type checker.
Reals = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int64]
Ints = NDArray[np.int32]
Flags = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Camera = tuple[float, float, float, float, float]


class Kernel(Generic[P, R]):
    """A stage, compiled once for the declared types, on the first call or by ``ready``.

    Attributes:
        function: the plain Python function.
    """

    def __init__(self, function: Callable[P, R], arguments: tuple[types.Type, ...]) -> None:
        self.function = function
        self._arguments = arguments
        self._compiled: Callable[P, R] | None = None
        self.__doc__, self.__name__ = function.__doc__, function.__name__

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        if self._compiled is None:
            self.ready()
        assert self._compiled is not None
        return self._compiled(*args, **kwargs)

    @cached_property
    def cache(self) -> KernelCache:
        """Files in which the compiled kernel is stored."""
        return KernelCache(self.function)  # type: ignore[no-untyped-call]

    @cached_property
    def _made(self) -> Callable[P, R]:
        """Its numba dispatcher, or the function itself if compilation is disabled."""
        return part(self.function)

    def load(self) -> bool:
        """Load it from the cache; return whether it was there or needs no compilation."""
        if self._compiled is None:
            made = self._made
            if isinstance(made, Dispatcher) and not self.cache.holds(
                self._arguments, made.targetctx
            ):
                return False
            self.ready()
        return True

    def ready(self) -> None:
        """Load it from the cache, or compile it."""
        if self._compiled is not None:
            return
        made = self._made
        if isinstance(made, Dispatcher):
            made._cache = self.cache  # type: ignore[attr-defined]
            made.compile(self._arguments)
            made.disable_compile()
        self._compiled = made


def kernel(*arguments: types.Type) -> Callable[[Callable[P, R]], Kernel[P, R]]:
    """Make a function of these argument types a kernel; arguments are not converted."""
    return lambda function: Kernel(function, arguments)


def part(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function that kernels call, compiled as a part of them.

    Strict arithmetic (no ``fastmath``) on one thread: bit-identical results on every run. It
    releases the interpreter's lock, so that a recorder or a viewer can run meanwhile.
    """
    # With NUMBA_DISABLE_JIT, njit returns the function itself.
    return cast(Callable[P, R], numba.njit(nogil=True, error_model="numpy")(function))

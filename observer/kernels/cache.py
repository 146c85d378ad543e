"""Cache of compiled kernels: beside their source, or wherever numba's settings put it."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import caching

_ROOT = Path(__file__).parents[2]
_IMPORT = re.compile(r"^from (observer[.][\w.]+) import", re.MULTILINE)


@cache
def _sources(path: Path) -> str:
    """Return a digest of a kernel module and of all modules of this library that it imports.

    numba itself checks only the file of the called function, not those of the functions it calls.
    """
    texts: dict[Path, str] = {}
    new = {path}
    while new:
        texts |= {module: module.read_text(encoding="utf-8") for module in new}
        imported = {name for text in texts.values() for name in _IMPORT.findall(text)}
        new = {_file(name) for name in imported} - texts.keys()
    everything = "".join(texts[module] for module in sorted(texts))
    return hashlib.sha256(everything.encode()).hexdigest()


def _file(module: str) -> Path:
    path = _ROOT.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


class _Stamped:
    """Invalidates the cache as soon as the kernel or a part of it has changed."""

    _py_file: str

    def get_source_stamp(self) -> str:
        return _sources(Path(self._py_file))


class _Provided(_Stamped, caching.UserProvidedCacheLocator):
    """In ``NUMBA_CACHE_DIR``."""


class _Beside(_Stamped, caching.InTreeCacheLocator):
    """Beside the source."""


class _UserWide(_Stamped, caching.UserWideCacheLocator):
    """In the user's cache folder, if the source's folder is not writable."""


class _ReadOnly(_Stamped, caching.InTreeCacheLocator):
    """Beside the source but read-only, as in a container image: compiled when that was built."""

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _ReadOnly:
        return cls(py_func, py_file)


class _CacheImpl(caching.CompileResultCacheImpl):
    _locator_classes = [_Provided, _Beside, _UserWide, _ReadOnly]  # noqa: RUF012


class KernelCache(caching.FunctionCache):
    """The cache of one kernel."""

    _impl_class = _CacheImpl

    def holds(self, arguments: tuple[Any, ...], target: Any) -> bool:
        """Return whether it is compiled for these types, this source and this processor."""
        target.refresh()
        key = self._index_key(arguments, target.codegen())  # type: ignore[no-untyped-call]
        return key in self._cache_file._load_index()

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the compiled kernel, if the cache is writable."""
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]

    @property
    def lock_file(self) -> str:
        """Path of a file to lock while kernels are compiled."""
        return os.path.join(self.cache_path, ".building")

"""Ahead-of-time compilation and the cache: fresh and stale entries, and unwritable folders."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numba
import numpy as np
import psutil
import pytest

from observer.kernels import cache
from observer.kernels.building import every_kernel, make_ready
from observer.kernels.compiled import REALS1, Kernel
from observer.kernels.neighbourhoods import linked

COMPILED = pytest.mark.skipif(
    bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="NUMBA_DISABLE_JIT is set"
)


def doubled(values: np.ndarray) -> np.ndarray:
    out = np.empty(len(values))
    for i in range(len(values)):
        out[i] = 2 * values[i]
    return out


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which kernels are kept."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    return tmp_path


def files(folder: Path) -> set[Path]:
    return set(folder.rglob("*.nbc"))


@COMPILED
def test_a_compiled_kernel_is_loaded_next_time(folder: Path) -> None:
    first = Kernel(doubled, (REALS1,))
    assert not first.load()
    np.testing.assert_array_equal(first(np.arange(3.0)), [0, 2, 4])
    kept = files(folder)
    assert len(kept) == 1
    second = Kernel(doubled, (REALS1,))
    assert second.load()
    np.testing.assert_array_equal(second(np.arange(3.0)), [0, 2, 4])
    assert files(folder) == kept


@COMPILED
@pytest.mark.usefixtures("folder")
def test_a_kernel_of_another_processor_is_not_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    Kernel(doubled, (REALS1,)).ready()
    assert Kernel(doubled, (REALS1,)).load()
    monkeypatch.setattr(cache.KernelCache, "_index_key", lambda *_: ("another processor",))
    assert not Kernel(doubled, (REALS1,)).load()


@COMPILED
@pytest.mark.usefixtures("folder")
def test_a_kernel_is_stale_when_its_source_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    Kernel(doubled, (REALS1,)).ready()
    monkeypatch.setattr(cache, "_sources", lambda _: "another text")
    assert not Kernel(doubled, (REALS1,)).load()


def test_a_kernel_is_stale_when_a_module_it_imports_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cache, "_ROOT", tmp_path)
    digest = cache._sources.__wrapped__
    kernels = tmp_path / "observer" / "kernels"
    kernels.mkdir(parents=True)
    texts = {
        "stage": "from observer.kernels.parts import (\n    part,\n)\n",
        "parts": "from observer.robust import FACTOR\n",
        "other": "FACTOR = 2\n",
    }
    for name, text in texts.items():
        (kernels / f"{name}.py").write_text(text, encoding="utf-8")
    factor = tmp_path / "observer" / "robust.py"
    factor.write_text("FACTOR = 1\n", encoding="utf-8")
    before = digest(kernels / "stage.py")
    (kernels / "other.py").write_text("FACTOR = 3\n", encoding="utf-8")
    assert digest(kernels / "stage.py") == before
    factor.write_text("FACTOR = 4\n", encoding="utf-8")
    assert digest(kernels / "stage.py") != before


@COMPILED
def test_a_kernel_works_without_a_writable_cache(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**_: object) -> None:
        raise PermissionError("read-only file system")

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    kernel = Kernel(doubled, (REALS1,))
    assert not kernel.load()
    np.testing.assert_array_equal(kernel(np.arange(3.0)), [0, 2, 4])
    assert not files(folder)


@COMPILED
def test_other_types_are_refused_rather_than_compiled() -> None:
    with pytest.raises(TypeError, match="No matching definition"):
        linked(np.zeros((1, 2)), np.ones(2, np.bool_))  # type: ignore[arg-type]


def test_all_kernels_are_found_and_compiled() -> None:
    assert {"pose_fit.fit_pose", "motion_test.pooled", "neighbourhoods.linked"} <= set(
        every_kernel()
    )
    messages: list[str] = []
    make_ready(messages.append)
    messages.clear()
    make_ready(messages.append)
    assert messages == []
    assert all(kernel.load() for kernel in every_kernel().values())


# CI compiles all kernels from scratch during setup, then checks that they are loaded.
@COMPILED
@pytest.mark.slow
@pytest.mark.patient
@pytest.mark.timeout(600)
def test_compilation_without_a_cache_is_reported_and_done_once(tmp_path: Path) -> None:
    program = (
        "from observer.kernels.building import make_ready, every_kernel\n"
        "messages = []\n"
        "make_ready(messages.append)\n"
        "assert all(kernel.load() for kernel in every_kernel().values())\n"
        "print(len(messages))\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    messages = [
        subprocess.run(
            [sys.executable, "-c", program], env=environment, check=True, capture_output=True,
            text=True, timeout=300,
        ).stdout.strip()
        for _ in range(2)
    ]  # fmt: skip
    assert messages == ["1", "0"]
    assert len(files(tmp_path)) >= len(every_kernel())
    ended = subprocess.run(
        [sys.executable, "-m", "observer.kernels"], env=environment, check=True,
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert ended.stdout.strip() == "all kernels are compiled"


@COMPILED
@pytest.mark.slow
@pytest.mark.timeout(120)
def test_compilation_ends_with_the_process_that_started_it(tmp_path: Path) -> None:
    program = "from observer.kernels.building import make_ready; make_ready(print)"
    asker = psutil.Popen(
        [sys.executable, "-c", program], stdout=subprocess.DEVNULL,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
    )  # fmt: skip
    compiling: list[psutil.Process] = []
    # The one that was started, at least one of its pool, and the pool's resource tracker.
    while len(compiling) < 3 and asker.poll() is None:
        time.sleep(0.1)
        compiling = asker.children(recursive=True)
    assert asker.poll() is None
    asker.kill()
    asker.wait()
    _, alive = psutil.wait_procs(compiling, timeout=10)
    for process in alive:
        process.kill()
    assert not alive

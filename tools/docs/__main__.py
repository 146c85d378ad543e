"""Build the documentation into a folder; without one into ``docs/site``.

    python -m tools.docs [FOLDER]

Reads no network. Links that lead nowhere are errors.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from mkdocs.commands.build import build
from mkdocs.config import load_config
from mkdocs.exceptions import Abort, MkDocsException

from tools import ROOT

SITE = ROOT / "docs" / "site"
# Written last: if it is missing, other files may be missing too.
STAMP = ".complete"
# They contain the address of a public site, which this one does not have.
_NOT_SERVED = ("404.html", "sitemap.xml", "sitemap.xml.gz", "objects.inv")


def build_site(site: Path) -> None:
    """Build the documentation into a folder, in place of what is there.

    Raises:
        MkDocsException: a page is faulty; what is wrong was logged.
    """
    # Built aside and renamed, so that an interrupted build leaves no half-built site.
    fresh = site.with_name(f"{site.name}.new")
    shutil.rmtree(fresh, ignore_errors=True)
    configuration = load_config(str(ROOT / "docs" / "mkdocs.yml"), site_dir=str(fresh), strict=True)
    configuration.plugins.on_startup(command="build", dirty=False)
    try:
        build(configuration)
    finally:
        configuration.plugins.on_shutdown()
    for name in _NOT_SERVED:
        (fresh / name).unlink(missing_ok=True)
    (fresh / STAMP).touch()
    shutil.rmtree(site, ignore_errors=True)
    fresh.rename(site)


def main(arguments: list[str]) -> int:
    try:
        build_site(Path(arguments[0]).resolve() if arguments else SITE)
    except (MkDocsException, Abort) as error:
        sys.stderr.write(f"the documentation could not be built: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

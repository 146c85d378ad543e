"""Write the glossary as a module of the page to the standard output.

    python -m tools.packaging.page_glossary

``tools/packaging/frontend.py types`` makes ``static/app/elements/glossary.js`` from it.
"""

from __future__ import annotations

import json
import sys

from app.contract.glossary import GLOSSARY


def page_glossary() -> str:
    """Return the module's text, before prettier."""
    meanings = {term.name: term.meaning for term in GLOSSARY}
    return (
        "/** Words and their meaning, for tooltips: made from app/contract/glossary.py. */\n\n"
        f"export const GLOSSARY = {json.dumps(meanings, ensure_ascii=False)};\n"
    )


if __name__ == "__main__":
    sys.stdout.buffer.write(page_glossary().encode())

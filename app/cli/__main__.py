"""``python -m app.cli``: as ``dynamic-observer``."""

from app.cli import main

if __name__ == "__main__":
    main()

"""Entry point of ``python -m app.cli``, the same as ``dynamic-observer``."""

from app.cli import main

if __name__ == "__main__":
    main()

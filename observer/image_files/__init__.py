"""Image files: reading them, and finding them in folders."""

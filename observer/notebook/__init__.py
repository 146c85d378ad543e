"""Notebook interface: the objects that ``observer.open`` and ``observer.load`` return."""

"""For notebooks: what ``observer.open`` and ``observer.load`` give."""

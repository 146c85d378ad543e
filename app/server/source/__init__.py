"""Which source is open, and what is shown of it."""

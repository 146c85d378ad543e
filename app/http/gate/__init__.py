"""Access control: host, origin, token and size of every request."""

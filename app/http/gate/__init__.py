"""Who may come in: host, origin, token and size of every request."""

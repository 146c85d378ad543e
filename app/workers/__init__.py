"""Jobs that processes of their own do; see ``app.runtime.worker``."""

"""Jobs that run in processes of their own; see ``app.runtime.worker``."""

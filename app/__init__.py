"""The server: processes, storage, viewer and web panel around the ``observer`` library."""

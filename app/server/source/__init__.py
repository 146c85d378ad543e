"""The open source and its views."""

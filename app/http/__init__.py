"""The web layer: HTTP, WebSockets, and who may come in."""

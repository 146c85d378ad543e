"""The web layer: HTTP, WebSockets and access control."""

"""The REST interface: thin routers over the server."""

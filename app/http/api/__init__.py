"""The REST interface: thin routers over the station."""

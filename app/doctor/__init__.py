"""``dynamic-observer doctor``: find what would prevent or limit a start on this machine."""

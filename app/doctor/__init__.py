"""``dynamic-observer doctor``: what would hinder or limit a start on this machine."""

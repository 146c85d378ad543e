"""Cost of the running system, measured from outside through its own ports."""

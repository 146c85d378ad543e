"""What the running system costs: measured from outside, over its own ports."""

"""Motion capture as it comes: servers on the network, and their clocks."""

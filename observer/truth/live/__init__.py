"""Live motion capture: servers on the network, and their clocks."""

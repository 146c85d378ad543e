"""Many combinations of parameters over many sources, spread over the processes of a cluster."""

"""The engine process: plays a source, observes it, draws what is watched."""

"""Engine process: plays a source, observes it and draws the views being watched."""

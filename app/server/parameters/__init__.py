"""The current parameters, and the presets."""

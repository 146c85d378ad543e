"""The parameters in force and their presets."""

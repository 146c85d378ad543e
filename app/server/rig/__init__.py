"""How the camera stands on its robot: edited and estimated."""

"""WebSockets: live telemetry, views, driving and the 3D viewer."""

"""Obstacles as bodies over time: motion and turning, box, points and number."""

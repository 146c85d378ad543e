"""Driving to a goal among moving obstacles: predictions, planning, and the reasons for a choice."""

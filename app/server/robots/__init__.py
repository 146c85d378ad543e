"""Driving, as far as the server has a part in it; ``RobotManager`` is the door.

Whether a robot moves is decided in the drive process alone. Here is who may ask it, which robots
it is given, and what of it is shown and kept.
"""

from app.server.robots.absent import AbsentDrive
from app.server.robots.manager import RobotManager

__all__ = ["AbsentDrive", "RobotManager"]

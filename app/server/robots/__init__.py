"""The server's part in driving; ``RobotManager`` is the entry point.

The drive process alone decides whether a robot moves. This package decides who may send it requests
and which robots it gets, and it shows and stores what happens.
"""

from app.server.robots.absent import AbsentDrive
from app.server.robots.manager import RobotManager
from app.server.robots.rearming import ArmedRobot

__all__ = ["AbsentDrive", "ArmedRobot", "RobotManager"]

"""Commands as an emulated robot logs them: number and argument."""

from __future__ import annotations

from observer.robots.arcos import Command

ENABLE_1 = (int(Command.ENABLE), 1)
E_STOP = (int(Command.E_STOP), None)
STANDSTILL = [(29, None), (11, 0), (21, 0)]
PULSE = (0, None)

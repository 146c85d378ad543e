"""Choices that people have for an export.

The help texts of the command line import them, so nothing slow is imported here.
"""

from __future__ import annotations

from typing import Literal

TableName = Literal[
    "obstacles",
    "frames",
    "truth",
    "matched_truth",
    "odometry",
    "robots",
    "goal",
    "map",
    "parameters",
]
TableFormat = Literal["csv", "parquet"]
# Frame of a point cloud.
CloudFrame = Literal["world", "camera"]
# Storage of the messages of a ROS 2 bag.
BagStorage = Literal["sqlite3", "mcap"]

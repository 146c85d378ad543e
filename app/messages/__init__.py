"""What the web process and the engine process say to each other.

Commands are request and reply; events are ordered and numbered. Both travel as plain frozen
dataclasses; images and clouds do not travel here but through ``app.runtime.latest``.
"""

from __future__ import annotations

from app.messages.commands import (
    BeginCalibration,
    ChangeCalibration,
    CloseSource,
    Command,
    ExplainPixel,
    LiveTruthOrder,
    LookAtFloor,
    MeasureDepth,
    OpenSource,
    PreviewCalibration,
    RecordOrder,
    RecordRobots,
    SaveRing,
    SetParameters,
    SetPlayback,
    SetTruth,
    Shutdown,
    StopRun,
    TakeScenePairs,
    WatchViews,
)
from app.messages.events import (
    BoardLookEvent,
    BoardViewsEvent,
    DenseStereoEvent,
    EngineLostEvent,
    EngineStartedEvent,
    EngineState,
    Event,
    HeartbeatEvent,
    ObservationEvent,
    SkippedFrameEvent,
    StateEvent,
)
from app.messages.views import (
    CAMERA_NAMES,
    CLOUD_NAME,
    DISPARITY_NAME,
    VIEW_NAMES,
)

__all__ = [
    "CAMERA_NAMES",
    "CLOUD_NAME",
    "DISPARITY_NAME",
    "VIEW_NAMES",
    "BeginCalibration",
    "BoardLookEvent",
    "BoardViewsEvent",
    "ChangeCalibration",
    "CloseSource",
    "Command",
    "DenseStereoEvent",
    "EngineLostEvent",
    "EngineStartedEvent",
    "EngineState",
    "Event",
    "ExplainPixel",
    "HeartbeatEvent",
    "LiveTruthOrder",
    "LookAtFloor",
    "MeasureDepth",
    "ObservationEvent",
    "OpenSource",
    "PreviewCalibration",
    "RecordOrder",
    "RecordRobots",
    "SaveRing",
    "SetParameters",
    "SetPlayback",
    "SetTruth",
    "Shutdown",
    "SkippedFrameEvent",
    "StateEvent",
    "StopRun",
    "TakeScenePairs",
    "WatchViews",
]

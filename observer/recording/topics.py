"""Topics of a recording: their names, the type of their messages, and how they are stored."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from observer.jsonl import ObservationLine
from observer.recording import payloads
from observer.recording.json_schema import json_schema


@dataclass(frozen=True)
class Topic:
    """A kind of message.

    Attributes:
        name: as shown by tools.
        encoding: of its messages, ``json`` or ``protobuf``.
        schema_name: Foxglove's, e.g. ``foxglove.RawImage``, or our own, which begin with
            ``dynamic_observer.``
        schema_encoding: ``jsonschema`` or ``protobuf``. schema: returns its bytes, made on demand.
        bulk: for images and clouds, which go into chunks of their own, so that the rest of a
            recording can be read without them.
        latched: whether its last message stays valid until the next one.
    """

    name: str
    encoding: str
    schema_name: str
    schema_encoding: str
    schema: Callable[[], bytes]
    bulk: bool = False
    latched: bool = False


def _own(name: str, payload: type[Any], *, latched: bool = False) -> Topic:
    def schema() -> bytes:
        return json.dumps(json_schema(payload)).encode()

    return Topic(
        name, "json", f"dynamic_observer.{payload.__name__}", "jsonschema", schema, False, latched
    )


def _foxglove(name: str, message: str, *, bulk: bool = False, latched: bool = False) -> Topic:
    def schema() -> bytes:
        # Imported here because it takes a while and only writers need it.
        import foxglove.messages

        return bytes(getattr(foxglove.messages, message).get_schema().data)

    return Topic(name, "protobuf", f"foxglove.{message}", "protobuf", schema, bulk, latched)


RUN = _own("/run", payloads.RunFacts, latched=True)
FRAME = _own("/frame", payloads.RecordedFrame)
OBSERVATION = _own("/observation", ObservationLine)
EGO_MOTION = _own("/ego_motion", payloads.EgoMotionPayload)
PARAMETERS = _own("/parameters", payloads.ParameterRevision, latched=True)
TRUTH = _own("/truth", payloads.TruthPayload)
MATCHED_TRUTH = _own("/truth/matched", payloads.MatchedTruth)
MOTION_CAPTURE = _own("/motion_capture", payloads.CapturePayload)
ROBOT = _own("/robot", payloads.RobotRow)
LOCAL_MAP = _own("/local_map", payloads.LocalMapPayload)
SKIPPED = _own("/skipped", payloads.SkippedPayload)
INCIDENT = _own("/incident", payloads.Incident)

LEFT_RAW = _foxglove("/camera/left/image", "RawImage", bulk=True)
RIGHT_RAW = _foxglove("/camera/right/image", "RawImage", bulk=True)
LEFT_JPEG = _foxglove("/camera/left/image", "CompressedImage", bulk=True)
RIGHT_JPEG = _foxglove("/camera/right/image", "CompressedImage", bulk=True)
LEFT_CALIBRATION = _foxglove("/camera/left/calibration", "CameraCalibration", latched=True)
RIGHT_CALIBRATION = _foxglove("/camera/right/calibration", "CameraCalibration", latched=True)
CLOUD = _foxglove("/cloud", "PointCloud", bulk=True)
SCENE = _foxglove("/scene/obstacles", "SceneUpdate")
EDGES = _foxglove("/scene/obstacles/edges", "PointCloud")
TRUE_SCENE = _foxglove("/scene/truth", "SceneUpdate")
TRUE_EDGES = _foxglove("/scene/truth/edges", "PointCloud")
TRANSFORMS = _foxglove("/tf", "FrameTransforms")
ODOMETRY = _foxglove("/odometry", "Odometry")
LOG = _foxglove("/log", "Log")

"""Luxonis' ``calib.json`` of OAK cameras, as DepthAI exports a device's EEPROM; centimetres.

Conventions of depthai's CalibrationHandler: a camera's extrinsics map a point of its own frame
into that of ``toCameraSocket``; frames are OpenCV's (x right, y down, z forward); distortion is in
OpenCV's order k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 and two tilts.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, TypeAlias, TypeVar

import numpy as np
from pydantic import PlainValidator

from observer.calibration.formats.numbers import RowOrColumn, WholeNumber, array, shaped
from observer.calibration.formats.understanding import Draft, DraftCamera, check_alike
from observer.camera import DistortionModel
from observer.errors import CalibrationError
from observer.geometry import Float64Array, Pose
from observer.text_files import FileModel, PlainData, dotted, one_of, validated

_CAMERAS = "cameraData"
_STEREO = "stereoRectificationData"
# DepthAI's CameraModel: 0 is Perspective, 1 Fisheye; OpenCV has none of the others.
_MODELS: dict[str, DistortionModel] = {"0": "radtan", "1": "equidistant"}


def _socket(value: PlainData) -> int:
    number = float(shaped([value], 1)[0])
    if number != int(number) or not -1 <= number <= 1000:
        raise ValueError("must be the number of a camera socket")
    return int(number)


_ModelT = TypeVar("_ModelT", bound=FileModel)
_Socket: TypeAlias = Annotated[int, PlainValidator(_socket)]


class _Point(FileModel):
    form = "contain the keys x, y and z"

    x: Annotated[Float64Array, array(1)]
    y: Annotated[Float64Array, array(1)]
    z: Annotated[Float64Array, array(1)]

    @property
    def vector(self) -> Float64Array:
        """(3,) x, y and z."""
        return np.concatenate([self.x, self.y, self.z])


class _Extrinsics(FileModel):
    rotationMatrix: Annotated[Float64Array, array(3, 3)]
    translation: _Point
    toCameraSocket: _Socket


class _Camera(FileModel):
    cameraType: Annotated[
        DistortionModel,
        one_of(_MODELS, "must be 0 (perspective) or 1 (fisheye), not {given}"),
    ] = "radtan"
    intrinsicMatrix: Annotated[Float64Array, array(3, 3)]
    distortionCoeff: RowOrColumn
    width: WholeNumber
    height: WholeNumber

    def drafted(self, name: str, key: str) -> DraftCamera:
        D = self.distortionCoeff
        if self.cameraType == "equidistant" and len(D) > 4:
            if D[4:].any():
                raise CalibrationError(
                    f"{name}: {key}.distortionCoeff of a fisheye camera must contain "
                    "4 coefficients followed by zeros"
                )
            D = D[:4]
        return DraftCamera(
            (self.width, self.height),
            self.intrinsicMatrix,
            D,
            self.cameraType,
            f"{key}.intrinsicMatrix",
            f"{key}.distortionCoeff",
        )


class _Linked(FileModel):
    """A camera of which only its extrinsics are needed."""

    extrinsics: _Extrinsics


class _Pair(FileModel):
    leftCameraSocket: _Socket
    rightCameraSocket: _Socket


class _Board(FileModel):
    stereoRectificationData: _Pair


def is_oak(data: Mapping[str, PlainData]) -> bool:
    """Return whether a mapping is a device's calibration as DepthAI writes it."""
    return isinstance(data.get(_CAMERAS), list)


def oak_draft(name: str, data: dict[str, PlainData]) -> Draft:
    """Return the calibration of the cameras that ``stereoRectificationData`` calls left and right.

    Their pose follows from the links from socket to socket. T is in centimetres.

    Raises:
        CalibrationError: sockets, cameras or links between them are missing.
        InputError: a key is missing or malformed.
    """
    pair = validated(_Board, data, name).stereoRectificationData
    cameras = _cameras(name, data.get(_CAMERAS, []))
    sockets = pair.leftCameraSocket, pair.rightCameraSocket
    for side, socket in zip(("left", "right"), sockets, strict=True):
        if socket not in cameras:
            there = ", ".join(str(each) for each in sorted(cameras)[:8]) or "none"
            raise CalibrationError(
                f"{name}: {_STEREO}.{side}CameraSocket is {socket}, but {_CAMERAS} has no such "
                f"camera (it has {there}); use the calibration of a device with a stereo pair"
            )
    if sockets[0] == sockets[1]:
        raise CalibrationError(
            f"{name}: {_STEREO} names socket {sockets[0]} as both left and right; they must differ"
        )
    left, right = (
        _validated(_Camera, cameras, socket, name).drafted(name, _key(socket)) for socket in sockets
    )
    check_alike(
        left,
        right,
        name,
        size=f"{_key(sockets[1])} width x height",
        model=f"{_key(sockets[1])}.cameraType",
    )
    pose = _pose(name, cameras, *sockets)
    notes = [f"sockets {sockets[0]} and {sockets[1]} are the left and right cameras ({_STEREO})"]
    if left.model == "equidistant":
        notes.append("fisheye lenses (cameraType 1)")
    return Draft(
        name,
        "OAK calib.json (DepthAI)",
        left,
        right,
        pose.rotation,
        pose.translation,
        unit="cm",
        R_key=f"{_key(sockets[0])}.extrinsics.rotationMatrix",
        T_key=f"{_key(sockets[0])}.extrinsics.translation",
        notes=tuple(notes),
    )


def _key(socket: int) -> str:
    return f"{_CAMERAS}[{socket}]"


def _validated(
    model: type[_ModelT], cameras: Mapping[int, PlainData], socket: int, name: str
) -> _ModelT:
    """Return the validated data of a socket's camera; messages say which camera it is."""
    return validated(
        model, cameras[socket], name, lambda location: dotted((_key(socket), *location))
    )


def _cameras(name: str, listed: PlainData) -> dict[int, PlainData]:
    """Return the entries of ``cameraData`` by the camera's socket."""
    cameras: dict[int, PlainData] = {}
    for entry in listed:
        if not isinstance(entry, list) or len(entry) != 2:
            raise CalibrationError(f"{name}: {_CAMERAS} must contain pairs of [socket, camera]")
        try:
            socket = _socket(entry[0])
        except ValueError as error:
            raise CalibrationError(f"{name}: {_CAMERAS}: a socket {error}") from None
        if socket in cameras:
            raise CalibrationError(f"{name}: {_key(socket)} is given twice; keep one of them")
        cameras[socket] = entry[1]
    return cameras


def _pose(name: str, cameras: Mapping[int, PlainData], left: int, right: int) -> Pose:
    """Return ``T_right_left``, its translation in the file's unit."""
    # Each camera's pose is given relative to one other: either the two chains meet in a camera, or
    # the pair is not linked.
    from_left, from_right = (_chain(name, cameras, start) for start in (left, right))
    for socket, T_socket_left in from_left.items():
        if socket in from_right:
            return from_right[socket].inverse() @ T_socket_left
    raise CalibrationError(
        f"{name}: the extrinsics do not connect {_key(left)} and {_key(right)} in either direction "
        "(toCameraSocket); calibrate the two cameras together"
    )


def _chain(name: str, cameras: Mapping[int, PlainData], start: int) -> dict[int, Pose]:
    """Return the poses T_socket_start of the cameras that are reached from ``start``."""
    reached = {start: Pose.identity()}
    at = start
    while True:
        link = _validated(_Linked, cameras, at, name).extrinsics
        if link.toCameraSocket not in cameras or link.toCameraSocket in reached:
            return reached
        try:
            step = Pose(link.rotationMatrix, link.translation.vector)
        except ValueError:
            raise CalibrationError(
                f"{name}: {_key(at)}.extrinsics.rotationMatrix must be a rotation matrix "
                f"(R^T R = I, det R = +1)"
            ) from None
        reached[link.toCameraSocket] = step @ reached[at]
        at = link.toCameraSocket

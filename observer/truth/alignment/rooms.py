"""Pose of the motion capture room in each segment's world, and of the camera on its body."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from observer.errors import NotObservable
from observer.geometry import Float64Array, Pose
from observer.truth.alignment.body_camera import BodyCamera, find_body_camera
from observer.truth.alignment.choices import AlignmentChoices
from observer.truth.alignment.curves import between
from observer.truth.alignment.frame_alignment import align_planar
from observer.truth.alignment.observed import ObservedRun, ObservedTrack, TrackKey
from observer.truth.alignment.time_offset import TimeOffset
from observer.truth.alignment.track_matching import Match, median_distance
from observer.truth.motion_capture import Capture, Trajectory

_UP_ROOM = np.array([0.0, 0.0, 1.0])
# If a body turns less than this, its centre and an error of the room's pose look alike.
_TURNS_RAD = np.radians(30)
# Metres: largest distance between the visible middle of a body and its origin.
_CENTRE_M = 0.5


@dataclass(eq=False)
class Rooms:
    """The room in the segments' worlds.

    Attributes:
        T_world_room: by segment. body_camera: None if the observer was not seen.
        residual_m: of the frame alignment, None without one. notes: one sentence each.
    """

    T_world_room: dict[int, Pose] = field(default_factory=dict)
    body_camera: BodyCamera | None = None
    residual_m: float | None = None
    notes: list[str] = field(default_factory=list)


def body_poses(body: Trajectory, times: Float64Array) -> Float64Array:
    """Return ``T_room_body`` (M, 4, 4) at truth's times (M,), NaN in gaps and without rotations."""
    poses = np.full((len(times), 4, 4), np.nan)
    if body.rotations is None:
        return poses
    place = between(body.times, body.positions, times)
    turned = _rotations_at(body.times, body.rotations, times)
    known = np.isfinite(place).all(axis=1) & np.isfinite(turned).all(axis=(1, 2))
    # An interpolated matrix is nearly a rotation; project it onto the nearest one.
    U, _, Vt = np.linalg.svd(turned[known])
    poses[known, :3, :3] = U @ Vt
    poses[known, :3, 3] = place[known]
    poses[known, 3] = [0, 0, 0, 1]
    return poses


def centre_positions(
    body: Trajectory, times: Float64Array, centre: Float64Array | None
) -> Float64Array:
    """Return positions (M, 3) metres, room, of the body's centre, or its origin if unknown."""
    place = between(body.times, body.positions, times)
    if centre is None:
        return place
    if body.rotations is None:
        return place + centre
    return np.asarray(place + _rotations_at(body.times, body.rotations, times) @ centre)


def _rotations_at(
    times: Float64Array, rotations: Float64Array, wanted: Float64Array
) -> Float64Array:
    return between(times, rotations.reshape(-1, 9), wanted).reshape(-1, 3, 3)


def place_rooms(
    run: ObservedRun,
    capture: Capture,
    time: TimeOffset,
    observer: str | None,
    matches: dict[TrackKey, Match],
    choices: AlignmentChoices,
) -> Rooms:
    """Find ``T_world_room`` of every segment for which it is observable, longest first."""
    rooms = Rooms()
    numbers = sorted(run.segment_numbers(), key=lambda n: -float((run.segments == n).sum()))
    for number in numbers:
        points = _points(run, capture, time, matches, number)
        try:
            if observer is not None and capture.bodies[observer].rotations is not None:
                T = _by_camera(run, capture.bodies[observer], time, number, points, choices, rooms)
            else:
                T = _by_points(points, choices, rooms)
        except NotObservable as error:
            rooms.notes.append(
                f"Segment {number}: the room frame cannot be determined, so only speeds are "
                f"compared: {error}."
            )
            continue
        rooms.T_world_room[number] = T
    return rooms


def _by_camera(
    run: ObservedRun,
    body: Trajectory,
    time: TimeOffset,
    number: int,
    points: tuple[Float64Array, Float64Array],
    choices: AlignmentChoices,
    rooms: Rooms,
) -> Pose:
    times, camera = run.camera_path(number)
    poses = body_poses(body, time.to_truth(times))
    if rooms.body_camera is not None:
        known = np.flatnonzero(np.isfinite(poses).all(axis=(1, 2)))
        if not len(known):
            raise NotObservable("motion capture did not see the observer during it")
        # The camera is fixed on the body; the segment's first poses have the least drift.
        k = known[0]
        T_room_camera = Pose.from_matrix(poses[k]) @ rooms.body_camera.T_body_camera
        return Pose.from_matrix(camera[k]) @ T_room_camera.inverse()
    found = find_body_camera(camera, poses, choices.assumed, points)
    if not found.observed[5] and choices.assumed.T_body_camera is None and len(points[0]) < 3:
        raise NotObservable(
            "the observer moved too little to determine where its camera points; let it drive at "
            "least half a metre"
        )
    rooms.body_camera = found
    rooms.residual_m = found.residual_m
    rooms.notes.extend(found.notes)
    if choices.mount is None and choices.T_body_camera is None:
        rooms.notes.append(
            "The tilt of the mount is unknown; the camera is assumed to be nearly level."
        )
    return found.T_world_room


def _by_points(
    points: tuple[Float64Array, Float64Array], choices: AlignmentChoices, rooms: Rooms
) -> Pose:
    up = choices.assumed.up_world
    seen, true = points
    up_world = np.array([0.0, -1.0, 0.0]) if up is None else up
    T_world_room, residual_m = align_planar(true, seen, _UP_ROOM, up_world)
    if rooms.residual_m is None:
        rooms.residual_m = residual_m
        rooms.notes.append(
            "The room was aligned using only the obstacles: yaw and translation in the floor "
            "plane; their height is taken from their visible part."
        )
        if up is None:
            rooms.notes.append(
                "The tilt of the mount is unknown, so the camera is assumed to be level."
            )
    return T_world_room


def _points(
    run: ObservedRun,
    capture: Capture,
    time: TimeOffset,
    matches: dict[TrackKey, Match],
    number: int,
) -> tuple[Float64Array, Float64Array]:
    """Return the obstacles' positions in one segment's world, and in the room."""
    seen, true = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for key, track in run.tracks.items():
        match = matches.get(key)
        if key.segment == number and match is not None and match.body is not None:
            seen.append(track.positions)
            body = capture.bodies[match.body]
            true.append(between(body.times, body.positions, time.to_truth(track.times)))
    a, b = np.concatenate(seen), np.concatenate(true)
    known = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    return a[known], b[known]


def track_distances(
    track: ObservedTrack, T_world_room: Pose, bodies: dict[str, Trajectory], time: TimeOffset
) -> dict[str, float]:
    """Return the median distance in the ground plane of a track from each body."""
    found = {}
    in_room = T_world_room.inverse().apply(track.positions)
    for name, body in bodies.items():
        true = between(body.times, body.positions, time.to_truth(track.times))
        found[name] = median_distance(in_room * [1, 1, 0], true * [1, 1, 0])
    return found


def body_centre(
    body: Trajectory,
    time: TimeOffset,
    tracks: list[tuple[ObservedTrack, Pose]],
) -> tuple[Float64Array | None, bool]:
    """Return the vector (3,) from a body's origin to the middle of what was seen of it.

    It is in the body's axes if it has rotations, and a median over all sightings; None if it cannot
    be determined. The second value is True if the body turned.
    """
    apart, headings = [], []
    for track, T_world_room in tracks:
        at = time.to_truth(track.times)
        seen = T_world_room.inverse().apply(track.positions)
        true = between(body.times, body.positions, at)
        difference = seen - true
        if body.rotations is not None:
            R = _rotations_at(body.times, body.rotations, at)
            difference = (np.swapaxes(R, 1, 2) @ difference[:, :, None])[:, :, 0]
            headings.append(np.arctan2(R[:, 1, 0], R[:, 0, 0]))
        apart.append(difference)
    every = np.concatenate(apart) if apart else np.zeros((0, 3))
    every = every[np.isfinite(every).all(axis=1)]
    if len(every) < 10:
        return None, False
    centre = np.median(every, axis=0)
    turned = False
    if headings:
        h = np.concatenate(headings)
        h = h[np.isfinite(h)]
        # If all headings agree, the mean of their unit vectors has length 1.
        turned = bool(np.abs(np.exp(1j * h).mean()) < np.cos(_TURNS_RAD / 2))
    if np.linalg.norm(centre[:2]) > _CENTRE_M:
        return None, turned
    return np.asarray(centre), turned

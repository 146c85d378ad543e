"""Step 9 of the method, second half: identities over time, and nothing else.

The speed of an obstacle stays the raw displacement of its frame; a track only says which
detections belong together. Its own smoothed velocity is used only to predict the next detection.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from observer.geometry import Float64Array, Pose, largest_sigma
from observer.methods.planar.results import Detection, Track
from observer.parameters import TrackingParameters
from observer.types import TrackState
from observer.vision.lifecycle import TrackIds, expired, next_state

# A track that was never confirmed ends after this many frames without a detection.
_TENTATIVE_MISSES = 1
_GATE_SIGMAS = 2.0
# Weight of the newest displacement in the velocity that predicts the next position: a single
# displacement in depth is mostly noise.
_NEWEST_WEIGHT = 0.25
_FAR = 1e9


class Tracker:
    """Nearest-neighbour tracker (Hungarian assignment) with confirmation and coasting."""

    def __init__(self, numbers: TrackIds | None = None) -> None:
        """``numbers`` supplies the ids of tracks; new ones if left out."""
        self._numbers = numbers or TrackIds()
        self._tracks: list[Track] = []
        self._expected_velocity: dict[int, Float64Array] = {}
        self._time = 0.0

    def update(
        self,
        detections: tuple[Detection, ...],
        T_track_camera: Pose,
        time: float,
        parameters: TrackingParameters,
    ) -> tuple[Track, ...]:
        """Assign every detection of this frame to a track.

        Args:
            T_track_camera: the camera's pose in the tracking frame at this frame.
            time: of this frame, source clock, seconds.

        Returns:
            All living tracks, oldest first.
        """
        elapsed = time - self._time
        self._time = time
        expected = [t.position + elapsed * self._expected_velocity[t.id] for t in self._tracks]
        seen = {
            track: detections[index]
            for track, index in self._assign(expected, detections, T_track_camera, parameters)
        }
        tracks = [
            self._continued(track, seen[i], T_track_camera, parameters)
            if i in seen
            else self._missed(track, expected[i])
            for i, track in enumerate(self._tracks)
        ]
        taken = {id(detection) for detection in seen.values()}
        tracks += [
            self._start_track(detection, T_track_camera, parameters)
            for detection in detections
            if id(detection) not in taken
        ]
        coast, patience = parameters.coast_frames, _TENTATIVE_MISSES
        self._tracks = [
            t for t in tracks if not expired(t.state, t.missed, coast=coast, patience=patience)
        ]
        living = {t.id for t in self._tracks}
        self._expected_velocity = {
            number: v for number, v in self._expected_velocity.items() if number in living
        }
        return tuple(self._tracks)

    def _assign(
        self,
        expected: list[Float64Array],
        detections: tuple[Detection, ...],
        T_track_camera: Pose,
        parameters: TrackingParameters,
    ) -> list[tuple[int, int]]:
        if not expected or not detections:
            return []
        places = T_track_camera.apply(np.stack([d.position for d in detections]))
        noise = np.array([largest_sigma(d.position_cov) for d in detections])
        distance = np.linalg.norm(np.stack(expected)[:, None] - places[None], axis=2)
        distance[distance > parameters.gate + _GATE_SIGMAS * noise] = _FAR
        rows, columns = linear_sum_assignment(distance)
        return [
            (int(i), int(j)) for i, j in zip(rows, columns, strict=True) if distance[i, j] < _FAR
        ]

    def _start_track(
        self, detection: Detection, T_track_camera: Pose, parameters: TrackingParameters
    ) -> Track:
        number = self._numbers.provisional()
        track = self._sighted(
            number, TrackState.TENTATIVE, 1, detection, T_track_camera, parameters
        )
        self._expected_velocity[track.id] = track.velocity
        return track

    def _continued(
        self,
        track: Track,
        detection: Detection,
        T_track_camera: Pose,
        parameters: TrackingParameters,
    ) -> Track:
        before, sightings = self._expected_velocity[track.id], track.sightings + 1
        now = self._sighted(track.id, track.state, sightings, detection, T_track_camera, parameters)
        self._expected_velocity[now.id] = before + _NEWEST_WEIGHT * (now.velocity - before)
        return now

    def _sighted(
        self,
        number: int,
        state: TrackState,
        sightings: int,
        detection: Detection,
        T_track_camera: Pose,
        parameters: TrackingParameters,
    ) -> Track:
        """Return the track after a sighting, under its final id once it is confirmed."""
        state = next_state(state, seen=True, confirmed=sightings >= parameters.confirm_hits)
        return Track(
            id=number if state is TrackState.TENTATIVE else self._numbers.confirmed(number),
            state=state,
            detection=detection,
            position=T_track_camera.apply(detection.position),
            velocity=T_track_camera.rotate(detection.velocity),
            sightings=sightings,
            missed=0,
        )

    def _missed(self, track: Track, expected: Float64Array) -> Track:
        return replace(
            track,
            state=next_state(track.state, seen=False, confirmed=False),
            position=expected,
            missed=track.missed + 1,
        )

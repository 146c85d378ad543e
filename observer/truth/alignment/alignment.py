"""Alignment of a run with a capture: clocks, frames and track-body matches, iteratively."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from itertools import islice

import numpy as np

from observer.errors import NotObservable
from observer.geometry import Float64Array
from observer.truth.alignment.body_camera import BodyCamera
from observer.truth.alignment.choices import AlignmentChoices
from observer.truth.alignment.correlation import correlation
from observer.truth.alignment.curves import (
    SpeedCurve,
    body_speed,
    longest_loss,
    seen_rotations,
    steady_speed,
    turn_rate,
)
from observer.truth.alignment.observed import ObservedRun, TrackKey
from observer.truth.alignment.result import Alignment
from observer.truth.alignment.rooms import Rooms, body_centre, place_rooms, track_distances
from observer.truth.alignment.time_offset import TimeOffset, find_time_offset
from observer.truth.alignment.track_matching import Match, match_tracks
from observer.truth.motion_capture import Capture, Trajectory

Pairs = list[tuple[SpeedCurve, SpeedCurve]]

# The camera's own motion is well known, so a body is only taken for the observer unasked if it
# correlates at least this well, and better than any other by this much.
_OBSERVER_CORRELATION, _OBSERVER_LEAD = 0.9, 0.05
# Largest residual of such a body, as a share of the standard deviation of the camera's speed.
_OBSERVER_RESIDUAL = 0.6
_ROUNDS = 2
# Seconds: an offset from the camera's own motion this certain needs no obstacles.
_ENOUGH_S = 0.01
_TRUE_TURN_SIGMA = 0.005


def align(
    observed: ObservedRun, capture: Capture, choices: AlignmentChoices | None = None
) -> Alignment:
    """Find the clocks' offset and drift, the room in the world, and which track is which body.

    If the frames cannot be aligned, the clocks still are: speeds need nothing else.

    Raises:
        NotObservable: the clocks cannot be aligned; one sentence says why and what would help.
        TruthError: a body that was chosen is not in the capture.
    """
    return _Aligning(observed, capture, choices or AlignmentChoices()).run()


class _Aligning:
    def __init__(self, run: ObservedRun, capture: Capture, choices: AlignmentChoices) -> None:
        self._run, self._capture, self._choices = run, capture, choices
        self._notes: list[str] = []
        named = [*choices.roles, *(name for name in choices.matches.values() if name is not None)]
        for name in named:
            if name not in capture.bodies:
                raise NotObservable(
                    f"motion capture has no body {name[:60]!r}; it has {_listed(capture.bodies)}"
                )
        self._speed, self._turn = run.own_curves()
        self._seen = {
            key: curve
            for key, track in run.tracks.items()
            if (curve := track.speed_curve()) is not None
        }
        self._true = {name: steady_speed(body) for name, body in capture.bodies.items()}
        self._observer = self._find_observer()
        self._obstacles = [
            name
            for name in capture.bodies
            if name != self._observer and choices.roles.get(name, "obstacle") == "obstacle"
        ]

    def run(self) -> Alignment:
        time, matches = self._first_offset()
        rooms = Rooms()
        for _ in range(_ROUNDS):
            rooms = place_rooms(
                self._run, self._capture, time, self._observer, matches, self._choices
            )
            matches = self._match(rooms, time, matches)
            # Align the frames again if they depend on the matches, which may have changed.
            if self._observer is None or rooms.body_camera is None:
                rooms = place_rooms(
                    self._run, self._capture, time, self._observer, matches, self._choices
                )
            time = self._better_offset(time, rooms, matches)
        centres = self._centres(rooms, time, matches)
        return Alignment(
            time=time,
            roles={
                **({} if self._observer is None else {self._observer: "observer"}),
                **dict.fromkeys(self._obstacles, "obstacle"),
            },
            segments=self._run.segment_starts(),
            T_world_room=rooms.T_world_room,
            frame_residual_m=rooms.residual_m,
            T_body_camera=None if rooms.body_camera is None else rooms.body_camera.T_body_camera,
            matches=matches,
            centres=centres,
            notes=tuple(dict.fromkeys([*self._notes, *rooms.notes])),
        )

    # ------------------------------------------------------------------ which body is the observer

    def _find_observer(self) -> str | None:
        roles = self._choices.roles
        chosen = next((name for name, role in roles.items() if role == "observer"), None)
        if chosen is not None:
            return chosen
        found: dict[str, float] = {}
        for name in self._capture.bodies:
            pairs = self._own_pairs(name) if name not in roles else []
            try:
                time = find_time_offset(pairs, search=self._choices.search, drift=False)
            except NotObservable:
                continue
            # A body that drives like the camera, but at another speed, is a different one.
            if self._speed is not None and time.residual_mps < _OBSERVER_RESIDUAL * float(
                np.nanstd(self._speed.values)
            ):
                found[name] = time.correlation
        ranked = sorted(found.items(), key=lambda item: -item[1])
        if not ranked or ranked[0][1] < _OBSERVER_CORRELATION:
            return None
        if len(ranked) > 1 and ranked[0][1] - ranked[1][1] < _OBSERVER_LEAD:
            return None
        self._notes.append(
            f"{ranked[0][0]} moves like the camera (correlation {ranked[0][1]:.2f}) and was "
            "assigned to the observer."
        )
        return ranked[0][0]

    def _own_pairs(self, name: str, camera: BodyCamera | None = None) -> Pairs:
        """Return the camera's own curves paired with those of the body that carries it."""
        body = self._capture.bodies[name]
        pairs: Pairs = []
        if self._speed is not None:
            true = body_speed(body)
            if camera is not None and body.rotations is not None:
                # The camera swings about the body's origin as the body turns.
                moved = body.fixed_points(camera.T_body_camera.translation)
                true = body_speed(Trajectory(name, body.times, moved))
            pairs.append((self._speed, true))
        if self._turn is not None and body.rotations is not None:
            times, rotations = seen_rotations(body)
            rate = turn_rate(times, rotations, _TRUE_TURN_SIGMA, longest_loss(times))
            if rate is not None:
                pairs.append((self._turn, rate))
        return pairs

    # ------------------------------------------------------------------ clocks

    def _first_offset(self) -> tuple[TimeOffset, dict[TrackKey, Match]]:
        search, drift = self._choices.search, self._choices.drift
        corrected = {
            key: Match(body, "person", None) for key, body in self._choices.matches.items()
        }
        refused: NotObservable | None = None
        if self._observer is not None:
            pairs = self._own_pairs(self._observer)
            # The turn rate does not depend on where on the robot the camera sits; speed does.
            for some in ([pairs[-1:]] if len(pairs) > 1 else []) + [pairs]:
                try:
                    own = find_time_offset(some, search=search, drift=drift)
                    return own, self._by_speed(own, corrected)
                except NotObservable as error:
                    refused = error
        try:
            matches = self._matches_by_lag(corrected)
            pairs = self._track_pairs(matches)
            if self._observer is not None:
                pairs = [*self._own_pairs(self._observer), *pairs]
            return find_time_offset(pairs, search=search, drift=drift), matches
        except NotObservable as error:
            raise (error if self._seen and self._obstacles else refused or error) from None

    def _matches_by_lag(self, corrected: dict[TrackKey, Match]) -> dict[TrackKey, Match]:
        """Match each track to the body whose speed fits best, at the lag best for all tracks."""
        tracks = [key for key in self._seen if key not in corrected]
        if len(self._obstacles) < 2:
            only = self._obstacles[0] if self._obstacles else None
            return {**{key: Match(only, "speed", None) for key in tracks}, **corrected}
        curves = {
            (key, name): correlation([(self._seen[key], self._true[name])])
            for key in tracks
            for name in self._obstacles
            if self._seen[key].known.sum() >= 5 and self._true[name].known.sum() >= 5
        }
        if not curves:
            return corrected
        low = min(float(c.lags[0]) for c in curves.values())
        high = max(float(c.lags[-1]) for c in curves.values())
        if self._choices.search is not None:
            low, high = self._choices.search
        lags = np.arange(low, high, 0.02)
        total, weights = np.zeros(len(lags)), np.zeros(len(lags))
        values: dict[TrackKey, Float64Array] = {}
        for key in tracks:
            own = [c for (track, _), c in curves.items() if track == key]
            if not own:
                continue
            r = np.array([np.interp(lags, c.lags, c.values, 0, 0) for c in own])
            w = np.array([np.interp(lags, c.lags, c.overlap_s, 0, 0) for c in own])
            values[key] = r
            total += r.max(axis=0) * w.max(axis=0)
            weights += w.max(axis=0)
        enough = weights >= max(0.4 * float(weights.max()), 1e-9)
        best = int(np.argmax(np.where(enough, total / np.maximum(weights, 1e-9), -1)))
        names = {
            key: self._obstacles[int(np.argmax(r[:, best]))]
            for key, r in values.items()
            if r[:, best].max() > 0
        }
        return {**{key: Match(name, "speed", None) for key, name in names.items()}, **corrected}

    def _by_speed(
        self, time: TimeOffset, corrected: dict[TrackKey, Match]
    ) -> dict[TrackKey, Match]:
        """Match each track to the body whose speed fits best at a known offset, as a start."""
        matches = dict(corrected)
        for key, seen in self._seen.items():
            errors = {}
            for name in self._obstacles:
                error = seen.values - self._true[name].at(time.to_truth(seen.times))
                if np.isfinite(error).sum() >= 5:
                    errors[name] = float(np.nanmedian(np.abs(error)))
            if key not in matches and errors:
                matches[key] = Match(min(errors, key=errors.__getitem__), "speed", None)
        return matches

    def _track_pairs(self, matches: dict[TrackKey, Match]) -> Pairs:
        return [
            (self._seen[key], self._true[match.body])
            for key, match in matches.items()
            if key in self._seen and match.body is not None
        ]

    def _better_offset(
        self, time: TimeOffset, rooms: Rooms, matches: dict[TrackKey, Match]
    ) -> TimeOffset:
        """Refine the offset with the camera's lever arm and the matched tracks."""
        near = (time.offset_s - 0.5, time.offset_s + 0.5)
        own: Pairs = []
        found = time
        if self._observer is not None:
            own = self._own_pairs(self._observer, rooms.body_camera)
            with contextlib.suppress(NotObservable):
                found = find_time_offset(own, search=near, drift=self._choices.drift)
                # The middle of an obstacle's visible part shifts as it turns, by more than the
                # camera's pose errs, and would only degrade the result.
                if found.sigma_s <= _ENOUGH_S:
                    return found
        with contextlib.suppress(NotObservable):
            pairs = [*own, *self._track_pairs(matches)]
            return find_time_offset(pairs, search=near, drift=self._choices.drift)
        return found

    # ------------------------------------------------------------------ track-body matches

    def _match(
        self, rooms: Rooms, time: TimeOffset, before: dict[TrackKey, Match]
    ) -> dict[TrackKey, Match]:
        bodies = {name: self._capture.bodies[name] for name in self._obstacles}
        lives, distances = {}, {}
        kept: dict[TrackKey, Match] = {}
        for key, track in self._run.tracks.items():
            T_world_room = rooms.T_world_room.get(key.segment)
            if T_world_room is None:
                if key in before:
                    kept[key] = before[key]
                continue
            lives[key] = (float(track.times[0]), float(track.times[-1]))
            distances[key] = track_distances(track, T_world_room, bodies, time)
        corrections = {
            key: name for key, name in self._choices.matches.items() if key in self._run.tracks
        }
        return {**kept, **match_tracks(lives, distances, corrections)}

    def _centres(
        self, rooms: Rooms, time: TimeOffset, matches: dict[TrackKey, Match]
    ) -> dict[str, tuple[float, float, float]]:
        centres = {}
        for name in self._obstacles:
            body = self._capture.bodies[name]
            tracks = [
                (self._run.tracks[key], rooms.T_world_room[key.segment])
                for key, match in matches.items()
                if match.body == name
                and key.segment in rooms.T_world_room
                and key in self._run.tracks
            ]
            centre, turned = body_centre(body, time, tracks)
            if centre is None:
                continue
            centres[name] = (float(centre[0]), float(centre[1]), float(centre[2]))
            if not turned:
                self._notes.append(
                    f"{name} hardly turned, so the offset between its centre and the tracked point "
                    "cannot be estimated; the visible part was taken as its centre."
                )
        return centres


def _listed(names: Iterable[str]) -> str:
    return ", ".join(name[:60] for name in islice(names, 8)) or "none"

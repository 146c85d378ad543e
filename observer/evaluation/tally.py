"""Comparison of one run with ground truth, frame by frame; all figures follow from these counts.

The definitions, the same for every method:

* An **instance** is a reported obstacle that is ``confirmed`` and ``moving`` and has a position.
  Coasting ones are neither right nor wrong, nor are those that move in place (``in_place``).
* A true obstacle **moves** above 0.05 m/s. It **counts** while it moves and is in sight, from 0.6 s
  after both began. It is **in sight** if at least half of it is visible, or if its box fills at
  least a tenth of the image, as that of a person close by does. If its visibility is unknown, it
  counts as visible.
* An instance and a true obstacle are **matched** one to one, within the gate (0.5 m, 3 m on the
  road) around the obstacle's upright axis. As in CLEAR-MOT (Bernardin and Stiefelhagen, 2008),
  pairs of the previous frame are kept while possible, and the others are assigned by the least
  total distance.
* An instance is **false** if no moving true obstacle, visible or not, lies within the gate.
* A second instance on one obstacle is not false but a **surplus box**; MOTA counts both.
* A miss is **flagged** if the line's status is lost, if a coasting instance lies
  within the gate, or if the line is degraded and motion could not be noticed in at least half of
  the box in which the obstacle is seen. It is also flagged if it is reported in its place as
  ``stopped`` or ``in_place`` and its true velocity lies within the stated 95 % region: a person who
  turns round is slow for a moment, but not unseen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from observer.evaluation.choices import GATE_M
from observer.evaluation.counts import Episode, FalseInstance, Sample, ScoredFor, Tally
from observer.evaluation.flagged import is_flagged, squared_length
from observer.evaluation.image_boxes import area, box_iou, clipped
from observer.evaluation.instances import Instance, axis_distance, centre_distance, instances_of
from observer.evaluation.lines import CheckedPose, Line
from observer.evaluation.surface import visible_surface
from observer.geometry import Float64Array, Pose
from observer.truth.contract import TrueBody, Truth
from observer.truth.counting import MOVING_MPS, VISIBLE_SHARE
from observer.truth.matching import SegmentWorlds

FILLING_SHARE = 0.1
SETTLING_S = 0.6

_REFUSED = 1e9


def tally(
    lines: Sequence[Line],
    truth: Truth,
    gate_m: float = GATE_M,
    scored_for: ScoredFor = "everything",
    image_size: tuple[int, int] | None = None,
) -> Tally:
    """Compare one run's lines with the ground truth.

    Args:
        image_size: width and height, to which reported boxes are clipped; None where unknown.
    """
    result = _Comparison(truth, gate_m, image_size).run(lines)
    result.scored_for = scored_for
    return result


class _Comparison:
    def __init__(self, truth: Truth, gate_m: float, image_size: tuple[int, int] | None) -> None:
        self._truth = truth
        self._image_size = image_size
        self._gate = gate_m
        self._tally = Tally()
        # By body id: current episode and its first radial shares, last identity, sides seen so far,
        # and the identity matched in the previous frame.
        self._running: dict[int, Episode] = {}
        self._first_radial: dict[int, list[float]] = {}
        self._identity: dict[int, tuple[int, int]] = {}
        self._sides: dict[int, frozenset[int]] = {}
        self._together: dict[int, tuple[int, int]] = {}
        self._worlds = SegmentWorlds(truth)
        self._camera_known = False

    def run(self, lines: Sequence[Line]) -> Tally:
        poses = (self._truth.camera_pose(line.time) for line in lines)
        self._camera_known = any(pose is not None for pose in poses)
        for line in lines:
            self._tally.frames_degraded += line.status == "degraded"
            self._tally.frames_lost += line.status == "lost"
            world = self._world(line)
            if world is None:
                self._tally.frames_without_world += 1
                continue
            if self._is_unknown(line.time):
                self._tally.frames_without_truth += 1
                continue
            self._tally.frames += 1
            self._compare(line, world)
        self._tally.episodes += self._running.values()
        # A body that moved in sight only briefly never counted.
        self._tally.episodes = [e for e in self._tally.episodes if e.ended - e.began >= SETTLING_S]
        return self._tally

    def _world(self, line: Line) -> Pose | None:
        """Return ``T_truth_world`` of the line's segment; None where it is unknown."""
        pose = None if line.pose is None else _pose(line.pose)
        T_world_truth = self._worlds.at(line.segment, line.frame, line.time, pose)
        return None if T_world_truth is None else T_world_truth.inverse()

    def _is_unknown(self, time: float) -> bool:
        """Return whether nothing is known at an instant; nobody in sight is something else."""
        if not self._camera_known or self._truth.camera_pose(time) is not None:
            return False
        return not self._truth.bodies(time)

    def _compare(self, line: Line, world: Pose) -> None:
        instances = instances_of(line, world)
        bodies = [b for b in self._truth.bodies(line.time) if b.role != "observer"]
        moving = [b for b in bodies if b.speed > MOVING_MPS]
        self._tally.moved |= bool(moving)
        self._tally.people |= any(b.kind == "person" for b in bodies)
        camera = self._camera_position(line, world)
        for body in moving:
            self._note_sides(body, camera)
        counting = self._counting(moving, line.time, camera)
        pairs = self._pair(counting, instances)
        self._together = {body.id: instances[j].identity for body, j in pairs}
        matched = {body.id: instances[j] for body, j in pairs}
        for body in counting:
            self._sample(body, matched.get(body.id), camera, line, world)
        taken = {j for _, j in pairs}
        counted = {b.id for b in counting}
        for j, instance in enumerate(instances):
            near = [b for b in moving if axis_distance(b, instance) <= self._gate]
            for body in near:
                episode = self._running.get(body.id)
                if episode is not None and episode.first_seen is None:
                    episode.first_seen = line.time
            if not near:
                self._tally.false.append(_false(instance, line, bodies, camera))
            elif j not in taken and all(b.id in counted for b in near):
                self._tally.surplus_boxes += 1

    def _camera_position(self, line: Line, world: Pose) -> Float64Array:
        true_pose = self._truth.camera_pose(line.time)
        if true_pose is not None:
            return true_pose.translation
        if line.pose is not None:
            return world.apply(line.pose.position)
        return world.translation

    def _note_sides(self, body: TrueBody, camera: Float64Array) -> None:
        if self._in_sight(body):
            seen = visible_surface(body, camera).sides
            self._sides[body.id] = self._sides.get(body.id, frozenset()) | seen

    def _in_sight(self, body: TrueBody) -> bool:
        if body.visible is None or body.visible >= VISIBLE_SHARE:
            return True
        if body.box_px is None or self._image_size is None:
            return False
        return area(body.box_px) >= FILLING_SHARE * math.prod(self._image_size)

    def _counting(
        self, moving: list[TrueBody], time: float, camera: Float64Array
    ) -> list[TrueBody]:
        """Return the bodies that count at this frame; start and end episodes."""
        in_sight = {b.id: b for b in moving if self._in_sight(b)}
        for number in [n for n in self._running if n not in in_sight]:
            self._tally.episodes.append(self._running.pop(number))
        for number, body in in_sight.items():
            if number not in self._running:
                distance = float(np.linalg.norm(body.position - camera))
                self._running[number] = Episode(
                    number, time, time, range_m=distance, kind=body.kind
                )
                self._first_radial[number] = []
            episode = self._running[number]
            episode.ended = time
            if time - episode.began <= SETTLING_S:
                self._first_radial[number].append(_radial(body, camera))
                episode.radial = float(np.mean(self._first_radial[number]))
        return [b for n, b in in_sight.items() if time - self._running[n].began >= SETTLING_S]

    def _pair(
        self, bodies: list[TrueBody], instances: list[Instance]
    ) -> list[tuple[TrueBody, int]]:
        if not bodies or not instances:
            return []
        distance = np.array([[axis_distance(b, i) for i in instances] for b in bodies])
        distance[distance > self._gate] = _REFUSED
        for row, body in enumerate(bodies):
            for column, instance in enumerate(instances):
                kept = self._together.get(body.id) == instance.identity
                if kept and distance[row, column] < _REFUSED:
                    # Matched before and still within the gate: preferred to any other pairing.
                    distance[row, column] -= _REFUSED
        rows, columns = linear_sum_assignment(distance)
        return [
            (bodies[r], int(c))
            for r, c in zip(rows, columns, strict=True)
            if distance[r, c] < _REFUSED
        ]

    def _sample(
        self,
        body: TrueBody,
        instance: Instance | None,
        camera: Float64Array,
        line: Line,
        world: Pose,
    ) -> None:
        common = (float(np.linalg.norm(body.position - camera)), body.speed, _radial(body, camera))
        if instance is None:
            flagged = is_flagged(line, body, world, self._gate)
            self._tally.samples.append(
                Sample(
                    *common,
                    matched=False,
                    kind=body.kind,
                    flagged=flagged,
                    segment=line.segment,
                    frame=line.frame,
                )
            )
            return
        before = self._identity.get(body.id)
        self._identity[body.id] = instance.identity
        # The velocity refers to an instant of its own, the middle of the displacement.
        then = {b.id: b for b in self._truth.bodies(instance.velocity_time)}.get(body.id, body)
        error = instance.velocity - then.velocity
        mahalanobis2 = None
        if instance.velocity_cov is not None:
            mahalanobis2 = squared_length(error, instance.velocity_cov)
        surface = visible_surface(body, camera).centre
        two_faces = len(self._sides.get(body.id, ())) >= 2
        self._tally.samples.append(
            Sample(
                *common,
                matched=True,
                distance_m=centre_distance(body, instance),
                surface_error_m=float(np.linalg.norm(instance.position - surface)),
                centre_error_m=centre_distance(body, instance) if two_faces else None,
                speed_error_mps=instance.speed - then.speed,
                velocity_error_mps=float(np.linalg.norm(error)),
                mahalanobis2=mahalanobis2,
                switched=before is not None and before != instance.identity,
                box_iou=self._box_iou(body, instance),
                kind=body.kind,
                segment=line.segment,
                frame=line.frame,
            )
        )

    def _box_iou(self, body: TrueBody, instance: Instance) -> float | None:
        if body.box_px is None or instance.box_px is None:
            return None
        size = self._image_size
        box = instance.box_px if size is None else clipped(instance.box_px, size)
        return box_iou(box, body.box_px)


def _false(
    instance: Instance, line: Line, bodies: list[TrueBody], camera: Float64Array
) -> FalseInstance:
    nearest = min(bodies, key=lambda body: axis_distance(body, instance), default=None)
    x, y, z = map(float, instance.position)
    return FalseInstance(
        frame=line.frame,
        segment=line.segment,
        time=line.time,
        id=instance.identity[1],
        position=(x, y, z),
        speed_mps=instance.speed,
        range_m=float(np.linalg.norm(instance.position - camera)),
        nearest_id=None if nearest is None else nearest.id,
        nearest_m=None if nearest is None else axis_distance(nearest, instance),
        nearest_moving=None if nearest is None else nearest.speed > MOVING_MPS,
    )


def _pose(entry: CheckedPose) -> Pose:
    return Pose.from_quaternion(entry.orientation_wxyz, entry.position)


def _radial(body: TrueBody, camera: Float64Array) -> float:
    sight = body.position - camera
    length = float(np.linalg.norm(sight)) * body.speed
    return abs(float(sight @ body.velocity)) / length if length > 0 else 0.0

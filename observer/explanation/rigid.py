"""Reasons of the rigid method: evidence of motion over time, feature by feature."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from observer.camera import StereoCamera
from observer.chi_square import log_share_above
from observer.explanation.answer import (
    Nearby,
    PixelAnswer,
    PixelVerdict,
    below,
    known,
    limits,
    look_around,
    radius_px,
)
from observer.explanation.texture import texture_around
from observer.methods.rigid.point_motion import PointEvidence
from observer.number_format import count_of
from observer.parameters import Parameters
from observer.types import UNSEEN_BECAUSE, Image, Unseen
from observer.vision.lifecycle import NO_OBSTACLE, is_provisional

# 99 of 100 static points stay below this Mahalanobis length (chi, 3 degrees of freedom).
_STANDING_LENGTH = 3.37
# A feature tracked for less than this has hardly been measured twice.
_YOUNG_S = 0.2
# Where a slow walker would not be significant, nothing is called static.
_SLOW_WALK_MPS = 1.0
_RATE = "evidence.false_alarms_per_frame"
_FEWEST = "evidence.min_points"


def explain_by_evidence(
    evidence: PointEvidence,
    camera: StereoCamera,
    parameters: Parameters,
    px: tuple[float, float],
    counts: Mapping[str, float],
    image: Image | None = None,
    unseen: Unseen | None = None,
) -> PixelAnswer:
    """Return the answer of the majority of the nearest features.

    Args:
        unseen: where motion would go unnoticed; None if not reported.
        image: the rectified left image, to say why there is no feature; None gives less detail.
        counts: figures of the camera's own motion, shown with the answer's.
    """
    near = look_around(evidence.px, px, camera, parameters.klt_tracking.spacing_px)
    if len(near.members) == 0:
        answer = _nothing_there(near, radius_px(camera), px, counts, image, parameters)
        cause = None if unseen is None else unseen.cause_at(px)
        if cause is None:
            return answer
        sentence = f"Motion could not be detected here: {UNSEEN_BECAUSE[cause]}. {answer.sentence}"
        return replace(answer, sentence=sentence)
    chosen = near.speakers
    moving = int(np.count_nonzero(evidence.dynamic[chosen])) * 2 > len(chosen)
    middle = float(np.median(evidence.significance[chosen]))
    # The figures are those of the majority's median feature by significance.
    agreeing = chosen[evidence.dynamic[chosen] == moving]
    order = np.argsort(evidence.significance[agreeing], kind="stable")
    speaker = int(agreeing[order[(len(order) - 1) // 2]])
    numbers = _numbers(evidence, speaker, middle, near) | dict(counts)
    verdict, sentence, change = _judge(evidence, speaker, middle, moving, parameters)
    return PixelAnswer(px, verdict, sentence, numbers, change)


def _nothing_there(
    near: Nearby,
    around_px: float,
    px: tuple[float, float],
    counts: Mapping[str, float],
    image: Image | None,
    parameters: Parameters,
) -> PixelAnswer:
    numbers = near.numbers | dict(counts)
    why = ""
    if image is None:
        change = "More texture or light here would give features."
    else:
        texture = texture_around(image, px, near.radius_px, parameters.klt_tracking.window_px)
        numbers["texture_grey_per_px"] = known(texture)
        why, change = _why_none(texture, around_px, parameters)
    sentence = f"No feature is tracked within {near.radius_px:.0f} px of here{why}; {near.nearest}."
    return PixelAnswer(px, PixelVerdict.TOO_FEW_FEATURES, sentence, numbers, change)


def _why_none(texture: float, around_px: float, parameters: Parameters) -> tuple[str, str]:
    """Return why no feature is tracked at this texture, and what would change it."""
    tracking, detector = parameters.klt_tracking, parameters.features.detector
    if texture < tracking.min_texture:
        least, _ = limits("klt_tracking.min_texture")
        why = (
            f": the texture, {texture:.2f} grey levels/px, is below the required "
            f"{tracking.min_texture:g}"
        )
        if texture < max(least, 0.05):
            return why, "No setting can help: without texture or light there is nothing to track."
        return why, (
            f"With klt_tracking.min_texture at {below(texture, 1)} or below (now "
            f"{tracking.min_texture:g}) one may be tracked here, though it may slide along edges."
        )
    # With squares of this side a feature is near this place wherever it is in its square.
    closer = int(around_px / math.sqrt(2))
    why = f", although there is texture ({texture:.1f} grey levels/px)"
    if closer < tracking.spacing_px:
        return why, (
            f"With klt_tracking.spacing_px at {closer} or below (now {tracking.spacing_px}) one "
            "would be searched for at exactly this place."
        )
    if detector != "shi_tomasi":
        words = partial(Parameters.value_in_words, "features.detector")
        return why, (
            f"{words(detector)} may find none here; with features.detector at "
            f"{words('shi_tomasi')} (now {words(detector)}) texture alone decides."
        )
    return why, "A feature found here is tracked from then on, if both cameras see it."


def _numbers(
    evidence: PointEvidence, speaker: int, middle: float, near: Nearby
) -> dict[str, float | None]:
    judged = evidence.significance[speaker] > 0
    return near.numbers | {
        "depth_m": known(evidence.depth[speaker]),
        "age_s": known(evidence.age_s[speaker]),
        "speed_mps": known(float(np.linalg.norm(evidence.velocity[speaker])) if judged else np.nan),
        "speed_std_mps": known(evidence.velocity_std[speaker] if judged else np.nan),
        "least_speed_mps": known(_least_speed(evidence, speaker) if judged else np.nan),
        "significance": known(middle),
        "threshold": known(evidence.threshold),
        "neighbours": int(evidence.neighbours[speaker]),
    }


def _least_speed(evidence: PointEvidence, speaker: int) -> float:
    """Return the speed, m/s, above which a motion would be significant here."""
    return float(evidence.threshold * evidence.velocity_std[speaker])


def _judge(
    evidence: PointEvidence, speaker: int, middle: float, moving: bool, parameters: Parameters
) -> tuple[PixelVerdict, str, str]:
    """Return verdict, explanation and what would change it.

    Args:
        speaker: the feature that stands for those around. middle: median of their significances.
    """
    if moving:
        return _judge_moving(evidence, speaker, middle, parameters)
    doubt = _doubt(evidence, speaker, middle, parameters)
    if doubt is not None:
        return PixelVerdict.UNDECIDED, *doubt
    least = _least_speed(evidence, speaker)
    if least > _SLOW_WALK_MPS:
        depth, age = float(evidence.depth[speaker]), float(evidence.age_s[speaker])
        return _too_far(depth, age, least, parameters.evidence.memory_s)
    pooled = count_of(int(evidence.neighbours[speaker]), "feature")
    return (
        PixelVerdict.STATIC,
        f"It is static, based on {pooled}: the apparent motion of "
        f"{_speed(evidence, speaker):.2f} m/s is noise ({_significance(evidence, middle)}).",
        f"Anything faster than {least:.2f} m/s would be detected here. "
        f"{_sooner(middle, evidence.threshold, parameters)}",
    )


def _judge_moving(
    evidence: PointEvidence, speaker: int, middle: float, parameters: Parameters
) -> tuple[PixelVerdict, str, str]:
    obstacle, speed = int(evidence.obstacle_id[speaker]), _speed(evidence, speaker)
    significance = _significance(evidence, middle)
    if middle > evidence.threshold or obstacle == NO_OBSTACLE:
        pooled = count_of(int(evidence.neighbours[speaker]), "feature")
        why = (
            f"It moves at {speed:.2f} m/s over ground, based on {pooled}{_whose(obstacle)}: "
            f"{significance}."
        )
    else:
        why = (
            f"It is part of {_name(obstacle)}, which was seen to move; the motion here is now "
            f"{speed:.2f} m/s ({significance})."
        )
    if obstacle == NO_OBSTACLE:
        return PixelVerdict.DYNAMIC, why, _until(middle, evidence.threshold, parameters)
    return PixelVerdict.DYNAMIC, why, _until_it_ends(evidence, speaker, parameters)


def _doubt(
    evidence: PointEvidence, speaker: int, middle: float, parameters: Parameters
) -> tuple[str, str] | None:
    """Return why it is undecided whether something moves, and what would change that.

    None if it is decided.
    """
    age, agreeing = float(evidence.age_s[speaker]), int(evidence.neighbours[speaker])
    if np.isnan(evidence.depth[speaker]):
        return (
            "The features here have no depth: they have no match in the other camera.",
            "This changes once the right camera sees this place too; no threshold affects it.",
        )
    if not evidence.cornered[speaker]:
        return (
            "The features here lie on a straight edge, along which they may slide: this is not "
            "evidence of motion.",
            "Texture across the edge would change this; no threshold affects it.",
        )
    if evidence.recurs[speaker]:
        return (
            "The texture here repeats along the row, so the match in the other camera, and with "
            "it the depth, may be wrong: this is not evidence of motion.",
            "Texture that does not repeat would change this; no threshold affects it.",
        )
    if middle == 0:
        return (
            f"The features here have been tracked for only {age:.2f} s, too few frames to be "
            "tested.",
            f"They are tested once they have been seen in {parameters.evidence.min_sightings} "
            "frames (evidence.min_sightings).",
        )
    if age < _YOUNG_S:
        return (
            f"The features here have been tracked for only {age:.2f} s, too briefly to decide.",
            f"It can be decided once they have been tracked for {_YOUNG_S:.1f} s, "
            f"{_YOUNG_S - age:.2f} s more.",
        )
    if middle > evidence.threshold:
        return (
            f"It may move, at {_speed(evidence, speaker):.2f} m/s, but only "
            f"{count_of(agreeing, 'feature')} here agree{'s' * (agreeing == 1)} on it.",
            f"With {_FEWEST} at {agreeing} or below it would count as moving.",
        )
    if middle > _STANDING_LENGTH:
        return (
            f"It may move, at {_speed(evidence, speaker):.2f} m/s, but this is not significant "
            f"enough: {_significance(evidence, middle)}.",
            _sooner(middle, evidence.threshold, parameters),
        )
    return None


def _speed(evidence: PointEvidence, speaker: int) -> float:
    """Return the speed over ground, m/s."""
    return float(np.linalg.norm(evidence.velocity[speaker]))


def _significance(evidence: PointEvidence, middle: float) -> str:
    return f"{middle:.1f} σ, where {evidence.threshold:.1f} σ is needed"


def _too_far(
    depth: float, age: float, least: float, memory: float
) -> tuple[PixelVerdict, str, str]:
    """Return the answer for a place where only motion faster than ``least`` m/s is detected."""
    if age < memory:
        return (
            PixelVerdict.UNDECIDED,
            f"No motion is visible, but the features here, {depth:.1f} m away, have been tracked "
            f"for only {age:.2f} s: anything slower than {least:.1f} m/s would not be detected "
            "yet.",
            f"It can be decided better once they have been tracked for {memory:g} s "
            "(evidence.memory_s).",
        )
    # The noise of a velocity grows with the square of the depth.
    near = depth * math.sqrt(_SLOW_WALK_MPS / least)
    return (
        PixelVerdict.TOO_FAR,
        f"It is too far away to decide: at {depth:.1f} m only motion faster than {least:.1f} m/s "
        "is significant, and none is.",
        f"Within about {near:.1f} m, {_SLOW_WALK_MPS:g} m/s would be detected; a larger "
        f"evidence.memory_s (now {memory:g} s) extends this range and delays detection.",
    )


def _whose(obstacle: int) -> str:
    return ", not yet part of an obstacle" if obstacle == NO_OBSTACLE else f" of {_name(obstacle)}"


def _name(obstacle: int) -> str:
    return "an unconfirmed obstacle" if is_provisional(obstacle) else f"obstacle {obstacle}"


def _until_it_ends(evidence: PointEvidence, speaker: int, parameters: Parameters) -> str:
    """Say what would end the obstacle that a feature is part of."""
    obstacle = int(evidence.obstacle_id[speaker])
    if evidence.on_outline[speaker]:
        return (
            f"No threshold affects this: the features on {_name(obstacle)} belong to it for as "
            "long as it is separate in depth."
        )
    seen, now = int(np.count_nonzero(evidence.obstacle_id == obstacle)), parameters.obstacles
    _, most = limits("obstacles.min_points")
    if seen + 1 > most:
        return (
            f"No value of obstacles.min_points (now {now.min_points}) would end {_name(obstacle)}, "
            "and for as long as it is tracked its features count as moving."
        )
    return (
        f"With obstacles.min_points at {seen + 1} or above (now {now.min_points}) "
        f"{_name(obstacle)} would not be seen any more, and end after {now.coast_s:g} s "
        "(obstacles.coast_s); as long as it is tracked, its features count as moving."
    )


def _until(middle: float, threshold: float, parameters: Parameters) -> str:
    """Say what would make a dynamic feature that is part of no obstacle static."""
    if middle <= threshold:
        return (
            "It still counts as moving because of earlier motion; this ends once its features "
            "have been static for a while."
        )
    now, (least, _) = parameters.evidence.false_alarms_per_frame, limits(_RATE)
    value = _two_digits(_rate_for(middle, threshold, now), down=True)
    if value < least:
        return f"No value of {_RATE} (now {now:g}) would change it: the minimum is {least:g}."
    return f"With {_RATE} at {value:g} or below (now {now:g}) it would not count as moving."


def _sooner(middle: float, threshold: float, parameters: Parameters) -> str:
    """Say what would make an insignificant feature count as dynamic."""
    now, (_, most) = parameters.evidence.false_alarms_per_frame, limits(_RATE)
    value = _two_digits(_rate_for(middle, threshold, now), down=False)
    if value > most:
        return (
            f"No value of {_RATE} (now {now:g}) would make it count as moving: the maximum is "
            f"{most:g}."
        )
    return f"With {_RATE} at {value:g} or above (now {now:g}) it would count as moving."


def _rate_for(length: float, threshold: float, now: float) -> float:
    """Return the false alarm rate whose threshold is ``length``; ``now`` gives ``threshold``.

    The threshold is the chi-squared quantile at the rate divided by the number of tests. That
    number need not be known, as it is the same for both.
    """
    log_ratio = log_share_above(length**2, df=3) - log_share_above(threshold**2, df=3)
    return now * float(np.exp(np.clip(log_ratio, -690.0, 690.0)))


def _two_digits(value: float, *, down: bool) -> float:
    """Round to two significant digits, to the side on which the answer changes."""
    unit = 10.0 ** (np.floor(np.log10(max(value, 1e-300))) - 1)
    steps = np.floor(value / unit) if down else np.floor(value / unit) + 1
    return float(steps * unit)

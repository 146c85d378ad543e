"""All parameters of the methods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from observer.parameters.common import EgoMotionParameters, FeaturesParameters, StereoParameters
from observer.parameters.monocular import MonocularParameters
from observer.parameters.parameter_set import ParameterSet
from observer.parameters.planar import (
    ClusteringParameters,
    FlowParameters,
    FramesParameters,
    MatchingParameters,
    MotionParameters,
    TrackingParameters,
)
from observer.parameters.rigid import (
    DenseParameters,
    EvidenceParameters,
    KltTrackingParameters,
    ObstacleParameters,
)
from observer.parameters.surf_extra import surf_missing


class Parameters(ParameterSet):
    """All parameters of the methods, one group per stage."""

    ego_motion: EgoMotionParameters = EgoMotionParameters()
    klt_tracking: KltTrackingParameters = KltTrackingParameters()
    evidence: EvidenceParameters = EvidenceParameters()
    dense: DenseParameters = DenseParameters()
    obstacles: ObstacleParameters = ObstacleParameters()
    monocular: MonocularParameters = MonocularParameters()
    stereo: StereoParameters = StereoParameters()
    frames: FramesParameters = FramesParameters()
    features: FeaturesParameters = FeaturesParameters()
    matching: MatchingParameters = MatchingParameters()
    flow: FlowParameters = FlowParameters()
    motion: MotionParameters = MotionParameters()
    clustering: ClusteringParameters = ClusteringParameters()
    tracking: TrackingParameters = TrackingParameters()

    @classmethod
    def _missing(cls, values: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
        wanted = values["features"]["detector"] == "surf"
        return {"features.detector": missing} if wanted and (missing := surf_missing()) else {}

"""Every tuning parameter, declared once: bounds, unit, label and help.

This declaration feeds the REST interface, the panel's form, the command line (``--set``) and the
documentation. Names are flat and dotted, as in ``ego_motion.ransac_threshold_px``. The guard's
parameters are in ``observer.guard.parameters``, the planner's in
``observer.navigation.parameters``.
"""

from observer.parameters.common import EgoMotionParameters, FeaturesParameters, StereoParameters
from observer.parameters.effect import effective, without_effect
from observer.parameters.fields import MODELS, ParameterValue
from observer.parameters.groups import Parameters
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
from observer.parameters.presets import PRESET_HELP, preset, preset_names
from observer.parameters.renamed import translated
from observer.parameters.rigid import (
    DenseParameters,
    EvidenceParameters,
    KltTrackingParameters,
    ObstacleParameters,
)
from observer.parameters.typed_text import typed_value

__all__ = [
    "MODELS",
    "PRESET_HELP",
    "ClusteringParameters",
    "DenseParameters",
    "EgoMotionParameters",
    "EvidenceParameters",
    "FeaturesParameters",
    "FlowParameters",
    "FramesParameters",
    "KltTrackingParameters",
    "MatchingParameters",
    "MonocularParameters",
    "MotionParameters",
    "ObstacleParameters",
    "ParameterSet",
    "ParameterValue",
    "Parameters",
    "StereoParameters",
    "TrackingParameters",
    "effective",
    "preset",
    "preset_names",
    "translated",
    "typed_value",
    "without_effect",
]

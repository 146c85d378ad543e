import pytest

from app.cli.assignments import chosen_parameters
from observer.errors import InputError, ParameterError
from observer.parameters import preset


def test_values_are_parsed_by_type() -> None:
    chosen = chosen_parameters(
        "paper",
        [
            "ego_motion.model=homography",
            "ego_motion.ransac_iterations=200",
            "flow.residual_threshold_px = 2.5",
            "matching.cross_check=false",
        ],
    )
    assert preset("paper").difference(chosen) == {
        "ego_motion.model": "homography",
        "ego_motion.ransac_iterations": 200,
        "flow.residual_threshold_px": 2.5,
        "matching.cross_check": False,
    }


@pytest.mark.parametrize(
    ("assignment", "sentence"),
    [
        ("flow.residual_threshold_px=NaN", "finite number from 0.1 to 30 px"),
        ("flow.residual_threshold_px=1e999", "finite number from 0.1 to 30 px"),
        ("flow.residual_threshold_px=true", "finite number from 0.1 to 30 px"),
        ("flow.residual_threshold_px=-1", "finite number from 0.1 to 30 px"),
        ("ego_motion.ransac_iterations=12.5", "whole number from 10 to 10000"),
        ("features.detector=surfs", "must be one of fast"),
        ("ego_motion.ransac_treshold_px=2", "did you mean ego_motion.ransac_threshold_px?"),
        ("ego_motion.shared_error=0.1", "has been renamed to ego_motion.noise_correlation"),
        ("ego_motion.model=one_camera", "one_camera has been renamed to monocular"),
        (
            "tracking.gate=4",
            "the current method, rigid; it applies to homography and affine",
        ),
    ],
)
def test_a_refused_value_names_the_parameter_and_its_range(assignment: str, sentence: str) -> None:
    with pytest.raises(ParameterError, match=assignment.split("=")[0]) as caught:
        chosen_parameters("default", [assignment])
    assert sentence in str(caught.value)


def test_an_assignment_without_a_value_shows_an_example() -> None:
    with pytest.raises(InputError, match=r"--set takes NAME=VALUE"):
        chosen_parameters("default", ["ego_motion.model"])


def test_an_unknown_preset_error_lists_the_available_presets() -> None:
    with pytest.raises(InputError, match="paper"):
        chosen_parameters("papers", [])

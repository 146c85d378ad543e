"""Parameters: declared once, accepted or refused as a whole, fully described."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.errors import InputError, ParameterError
from observer.navigation.parameters import AllParameters
from observer.parameters import (
    MODELS,
    PRESET_HELP,
    Parameters,
    effective,
    preset,
    preset_names,
    translated,
    without_effect,
)

SCHEMA = {entry["name"]: entry for entry in AllParameters.declared()}
NUMBERS = [n for n, e in SCHEMA.items() if e["type"] in ("number", "integer")]
REALS = [n for n, e in SCHEMA.items() if e["type"] == "number"]


def test_the_schema_lists_every_parameter_in_order_with_its_default() -> None:
    assert {name: entry["default"] for name, entry in SCHEMA.items()} == AllParameters().flat()
    assert list(SCHEMA) == list(AllParameters().flat())


@pytest.mark.parametrize("name", SCHEMA)
def test_every_parameter_has_what_a_form_needs(name: str) -> None:
    entry = SCHEMA[name]
    assert entry["title"]
    assert entry["help"].endswith(".")
    assert entry["group_help"]
    assert entry["models"]
    assert set(entry["models"]) <= set(MODELS)
    if entry["type"] == "choice":
        assert entry["default"] in entry["choices"]
        assert set(entry["labels"]) == set(entry["choices"])
    elif entry["type"] != "boolean":
        assert entry["minimum"] <= entry["default"] <= entry["maximum"]
        assert entry["step"] > 0


def test_titles_stand_alone() -> None:
    """Lists of changed values, search results and messages show them without their group."""
    titles = [entry["title"] for entry in SCHEMA.values()]
    assert len(set(titles)) == len(titles)
    assert [title for title in titles if " " not in title] == ["Method"]


@pytest.mark.parametrize("name", NUMBERS)
def test_range_limits_are_accepted_and_values_beyond_refused(name: str) -> None:
    low, high = SCHEMA[name]["minimum"], SCHEMA[name]["maximum"]
    step = 1 if SCHEMA[name]["type"] == "integer" else 1e-6
    for value in (low, high):
        assert AllParameters().changed({name: value}).flat()[name] == value
    for value in (low - step, high + step):
        with pytest.raises(ParameterError) as refused:
            AllParameters().changed({name: value})
        assert refused.value.problems == {name: AllParameters.describe_range(name)}


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, True, "1", None, [1], 10**400])
def test_values_other_than_finite_numbers_are_refused(value: object) -> None:
    before = AllParameters()
    for name in REALS:
        with pytest.raises(ParameterError) as refused:
            before.changed({name: value})
        assert "must be a finite number from" in refused.value.problems[name]


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("features.max_count", 600.5, "a whole number from 50 to 4000 points"),
        ("features.detector", "sift", "must be one of fast, shi_tomasi"),
        ("matching.cross_check", "yes", "must be true or false"),
        ("matching.cross_check", 1, "must be true or false"),
        ("ego_motion.ransac_treshold_px", 1.0, "did you mean ego_motion.ransac_threshold_px?"),
        ("nothing", 1, "there is no such parameter"),
    ],
)
def test_an_error_states_the_valid_values(name: str, value: object, sentence: str) -> None:
    with pytest.raises(ParameterError) as refused:
        AllParameters().changed({name: value})
    assert sentence in refused.value.problems[name]


def test_changes_are_all_or_nothing_and_report_every_problem() -> None:
    before = AllParameters()
    with pytest.raises(ParameterError) as refused:
        before.changed(
            {"flow.window_px": 21, "stereo.block_px": 1000, "x": 1, "tracking.gate": math.nan}
        )
    assert set(refused.value.problems) == {"stereo.block_px", "x", "tracking.gate"}
    assert before.flat() == AllParameters().flat()


@settings(max_examples=30)
@given(data=st.data())
def test_applying_the_difference_gives_the_other_parameters(data: st.DataObject) -> None:
    names = data.draw(st.lists(st.sampled_from(NUMBERS), unique=True))
    changes = {n: SCHEMA[n][data.draw(st.sampled_from(["minimum", "maximum"]))] for n in names}
    before = AllParameters()
    after = before.changed(changes)
    assert before.changed(before.difference(after)) == after
    assert set(before.difference(after)) <= set(changes)


def test_parameters_are_frozen() -> None:
    with pytest.raises(ValueError, match="frozen"):
        AllParameters().flow.window_px = 3  # type: ignore[misc]


def test_the_schema_states_which_models_use_a_parameter() -> None:
    assert SCHEMA["ego_motion.model"]["models"] == list(MODELS)
    assert SCHEMA["ego_motion.model"]["choices"] == list(MODELS)
    assert SCHEMA["ego_motion.ransac_iterations"]["models"] == ["rigid", "homography", "affine"]
    assert SCHEMA["evidence.radius_px"]["models"] == ["rigid", "monocular"]
    assert SCHEMA["monocular.height_m"]["models"] == ["monocular"]
    assert SCHEMA["flow.residual_threshold_px"]["models"] == ["homography", "affine"]


@pytest.mark.parametrize("model", MODELS)
def test_every_model_has_eight_basic_parameters(model: str) -> None:
    basic = [name for name, entry in SCHEMA.items() if entry.get("basic")]
    shown = [name for name in basic if model in SCHEMA[name]["models"]]
    assert len(shown) == 8
    assert "ego_motion.model" in shown
    assert ("ego_motion.ransac_threshold_px" in shown) == (model != "monocular")
    planar = model in ("affine", "homography")
    assert ("flow.residual_threshold_px" in shown) == planar
    # Titles are shown without their group there, so each must be clear, and unique, on its own.
    titles = [SCHEMA[name]["title"] for name in shown]
    assert len(set(titles)) == len(titles)


def test_presets_have_the_documented_values() -> None:
    assert preset_names() == ("paper", "default")
    assert set(PRESET_HELP) == set(preset_names())
    assert preset("default") == Parameters()
    assert preset("default").ego_motion.model == "rigid"
    paper = preset("paper").flat()
    # As in the publication.
    assert paper["features.detector"] == "fast"
    assert paper["matching.method"] == "descriptor"
    assert paper["ego_motion.model"] == "affine"
    assert paper["frames.interval"] == 1
    assert paper["motion.min_significance"] == 0
    assert not paper["flow.match_brightness"]
    # Every parameter that the preset changes must have an effect with the paper's model.
    changed = Parameters().difference(preset("paper"))
    assert all("affine" in SCHEMA[name]["models"] for name in changed)
    with pytest.raises(InputError, match="available are: paper, default"):
        preset("papre")
    with pytest.raises(InputError, match="no parameter named"):
        Parameters.describe_range("nothing")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ({"following.spacing_px": 9}, {"klt_tracking.spacing_px": 9}),
        ({"following.growth_noise": 0.1}, {"klt_tracking.scale_change_noise": 0.1}),
        ({"one_camera.tilt_deg": 5.0}, {"monocular.tilt_deg": 5.0}),
        ({"evidence.stretch": 0.2}, {"evidence.distortion_sigma": 0.2}),
        ({"motion.shared_error": 0.2}, {"motion.noise_correlation": 0.2}),
        ({"ego_motion.model": "one_camera"}, {"ego_motion.model": "monocular"}),
    ],
)
def test_old_names_are_translated_from_storage_but_refused_as_changes(
    old: dict[str, object], new: dict[str, object]
) -> None:
    assert translated(old) == new
    assert translated(new) == new
    Parameters().changed(new)
    (name,) = old
    with pytest.raises(ParameterError) as refused:
        Parameters().changed(old)
    assert "has been renamed to" in refused.value.problems[name]


def test_a_value_that_is_no_number_is_not_called_renamed() -> None:
    with pytest.raises(ParameterError) as refused:
        Parameters().changed({"tracking.gate": math.nan})
    assert refused.value.problems == {"tracking.gate": Parameters.describe_range("tracking.gate")}


def test_a_guard_change_does_not_affect_vision_parameters() -> None:
    before = AllParameters()
    after = before.changed({"guard.margin_m": 0.3})
    assert after != before
    assert after.vision == before.vision == Parameters()
    assert type(after.vision) is Parameters
    assert not any(name.startswith("guard.") for name in Parameters().flat())
    assert Parameters.own(after.flat()) == Parameters().flat()


def test_a_change_without_effect_is_refused_by_name() -> None:
    rigid = Parameters()
    for changes in ({"tracking.gate": 4.0}, {"stereo.max_depth_m": 5.0}):
        (name,) = changes
        with pytest.raises(ParameterError, match=f"{name}: has no effect .* applies to homography"):
            effective(rigid, {**changes, "evidence.radius_px": 30.0})
    # Effects are judged by the method that is selected after the change.
    assert effective(rigid, {"ego_motion.model": "affine", "tracking.gate": 4.0}) == rigid.changed(
        {"ego_motion.model": "affine", "tracking.gate": 4.0}
    )
    assert without_effect(["tracking.gate", "guard.margin_m", "unknown"], "affine") == {}

from app.cli.parameters import basic_parameters, parameter_table, preset_table
from observer.navigation.parameters import AllParameters


def test_the_table_has_one_row_for_every_parameter() -> None:
    rows = parameter_table(AllParameters.declared()).splitlines()[2:]
    assert [row.split("`")[1] for row in rows] == list(AllParameters().flat())


def test_basic_parameters_are_a_subset_in_the_same_order() -> None:
    rows = parameter_table(basic_parameters()).splitlines()[2:]
    names = [row.split("`")[1] for row in rows]
    assert {"ego_motion.ransac_threshold_px", "flow.residual_threshold_px"} <= set(names)
    assert names == [name for name in AllParameters().flat() if name in names]


def test_the_preset_table_lists_only_differences() -> None:
    rows = preset_table().splitlines()
    assert rows[0] == "| parameter | `paper` | `default` |"
    assert "| `ego_motion.model` | affine | rigid |" in rows
    assert "| `flow.match_brightness` | false | true |" in rows
    assert not any("stereo.matcher" in row for row in rows)

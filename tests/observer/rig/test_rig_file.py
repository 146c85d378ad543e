from __future__ import annotations

import textwrap

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.errors import InputError
from observer.geometry import Pose
from observer.rig import rig_file
from observer.rig.rig import LIMITS, Rig, RigMount, RigValue
from observer.rig.rig_file import read_rig, rig_text


def test_a_plain_number_is_typed_and_a_missing_or_empty_key_is_unknown() -> None:
    rig = read_rig("mount: {height_m: 0.41, tilt_deg: null, roll_deg: }", "rig.yaml")
    assert rig.mount.height_m == RigValue(0.41)
    assert rig.mount.height_m.origin == "typed"
    assert (rig.mount.tilt_deg, rig.mount.roll_deg, rig.mount.pan_deg) == (None, None, None)
    assert rig.camera_mount is None


def test_an_estimate_keeps_its_standard_deviation() -> None:
    rig = read_rig("mount: {height_m: {estimated: 0.41, sigma: 0.004}, tilt_deg: 5}", "rig.yaml")
    assert rig.mount.height_m == RigValue(0.41, 0.004)
    assert rig.mount.height_m.origin == "estimated"


def test_the_mount_is_in_radians_with_defaults_for_unknown_values() -> None:
    rig = read_rig("mount: {height_m: 0.41, tilt_deg: 10, roll_deg: -2, forward_m: 0.1}", "r")
    mount = rig.camera_mount
    assert mount is not None
    assert mount.tilt_rad == pytest.approx(np.radians(10))
    assert mount.roll_rad == pytest.approx(np.radians(-2))
    assert (mount.forward_m, mount.left_m, mount.pan_rad) == (0.1, None, 0.0)


def test_the_documentation_example_can_be_read() -> None:
    example = textwrap.dedent((rig_file.__doc__ or "").split("\n\n", 1)[1]).replace("...", "")
    rig = read_rig(example, "rig.yaml")
    assert rig.mount.tilt_deg == RigValue(5.2, 0.3)
    assert rig.models == {"observer": "amigo-sh", "obstacle": "p3dx-sh"}
    assert rig.ports == {"observer": "/dev/ttyUSB0", "obstacle": "socket://192.168.1.20:8101"}
    assert rig.T_body_base["amigo"].translation[2] == -0.15


def test_json_with_the_same_keys_is_accepted() -> None:
    rig = read_rig('{"mount": {"height_m": 0.41}, "for_simulated": true}', "rig.json")
    assert rig.mount.height_m == RigValue(0.41)
    assert rig.for_simulated


def _values(key: str) -> st.SearchStrategy[RigValue | None]:
    low, high = LIMITS[key]
    sigma = st.none() | st.floats(1e-12, 1e3)
    return st.none() | st.builds(RigValue, st.floats(low, high), sigma)


def _poses() -> st.SearchStrategy[Pose]:
    three = st.lists(st.floats(-3, 3), min_size=3, max_size=3)
    return st.builds(Pose.from_rotvec, three, three)


_NAMES = st.from_regex(r"\A[A-Za-zäß0-9_][A-Za-zé0-9 .:/()#+-]{0,20}\Z") | st.sampled_from(
    ["no", "12", "null", "1e3", "~x"[1:], "- a"[2:]]
)
_RIGS = st.builds(
    Rig,
    mount=st.builds(RigMount, **{key: _values(key) for key in LIMITS}),
    calibration=st.none() | st.from_regex(r"\A[0-9a-f]{1,64}\Z"),
    T_body_base=st.dictionaries(_NAMES, _poses(), max_size=3),
    models=st.dictionaries(
        st.sampled_from(["observer", "obstacle"]),
        st.sampled_from(["p3dx-sh", "p3dx", "amigo-sh", "amigo"]),
    ),
    for_simulated=st.booleans(),
    ports=st.dictionaries(
        st.sampled_from(["observer", "obstacle"]),
        st.from_regex(r"\A[/a-z][A-Za-z0-9 é_.:/,#{}\[\]'&*!|>%@~-]{0,40}[a-z0-9]\Z"),
    ).filter(lambda ports: len(set(ports.values())) == len(ports)),
)


@settings(max_examples=60)
@given(rig=_RIGS)
def test_a_written_rig_is_read_back_exactly(rig: Rig) -> None:
    again = read_rig(rig_text(rig), "rig.yaml")
    assert again.mount == rig.mount
    assert again.calibration == rig.calibration
    assert (again.models, again.for_simulated) == (rig.models, rig.for_simulated)
    assert again.ports == rig.ports
    assert list(again.T_body_base) == list(rig.T_body_base)
    for name, pose in rig.T_body_base.items():
        np.testing.assert_array_equal(again.T_body_base[name].matrix, pose.matrix)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty"),
        ("mount: {height: 0.4}", "mount.height is not a key of a rig; it is given in metres as"),
        ("mount: {tilt_rad: 0.1}", "given in degrees as tilt_deg"),
        ("mount: {size: 1}", "mount.size is not a key of a rig; the keys are mount.height_m"),
        ("mounts: {}", "mounts is not a key of a rig; the keys are mount, calibration"),
        ("mount: {height_m: 40}", "mount.height_m must be between 0.02 and 3 metres, not 40"),
        ("mount: {tilt_deg: 90}", "mount.tilt_deg must be between -89 and 89 degrees, not 90"),
        ("mount: {height_m: forty}", "mount.height_m must contain numbers"),
        ("mount: {height_m: .inf}", "mount.height_m must contain finite numbers"),
        ("mount: {height_m: [0.4]}", "mount.height_m must be one number"),
        ("mount: {height_m: 0.4 0.5}", "mount.height_m must be one number"),
        ("mount: {height_m: {estimated: 0.4}}", "mount.height_m.sigma is missing"),
        ("mount: {height_m: {estimated: 0.4, sigma: 0}}", "sigma must be a positive"),
        ("mount: {height_m: {estimated: 0.4, std: 1}}", "mount.height_m.std is not a key"),
        ("mount: 0.4", "mount must contain keys with values, not '0.4'"),
        ("mount: {height_m: 0.4, height_m: 0.5}", "height_m appears twice"),
        ("calibration: a/../b", "calibration must be a calibration's id"),
        ("calibration: [a]", "calibration must be one word"),
        ("models: {observer: roomba}", "models.observer must be one of p3dx-sh, p3dx, amigo-sh"),
        ("models: {leader: p3dx}", "the roles are observer and obstacle"),
        ("models: {observer: [p3dx]}", "models.observer must be a model's name"),
        ("ports: {leader: /dev/ttyUSB0}", "ports.leader is not a role"),
        ("ports: {observer: [/dev/ttyUSB0]}", "ports.observer must be a path or address"),
        ("ports: {observer: 'a\"b'}", "ports.observer must be a path or address of up to 200"),
        ("ports: {observer: ' /dev/ttyUSB0'}", "ports.observer must be a path"),
        (f"ports: {{observer: /{'x' * 200}}}", "ports.observer must be a path"),
        ("ports: {observer: /dev/a, obstacle: /dev/a}", "two different ports"),
        ("ports: /dev/ttyUSB0", "ports must contain keys with values"),
        ("T_body_base: {a: [1, 2, 3]}", "T_body_base.a must contain 3 or 4 rows of 4 numbers"),
        ("T_body_base: {a: [[1,0,0,0],[0,1,0,0],[0,0,2,0]]}", "T_body_base.a must be a rotation"),
        ("T_body_base: {a: [[1,0,0,150],[0,1,0,0],[0,0,1,0]]}", "divide millimetres by 1000"),
        (
            "T_body_base: {a: [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,2]]}",
            "the last row of T_body_base.a must be 0 0 0 1",
        ),
        ("T_body_base: {'a\"b': [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}", "a body's name must be"),
        ("for_simulated: yes", "for_simulated must be true or false, not 'yes'"),
        ("mount: &m {height_m: 0.4}\nmodels: *m", "alias or anchor"),
        ("<rig/>", "YAML or JSON"),
        ("mount: {", "not valid YAML"),
        ("- 1", "contains no keys"),
        ("# " + "x" * 100_001, "at most 100000 characters"),
    ],
)
def test_an_error_names_the_file_the_key_and_valid_values(text: str, said: str) -> None:
    with pytest.raises(InputError) as refused:
        read_rig(text, "rig.yaml")
    assert said in str(refused.value)
    assert str(refused.value).startswith("rig.yaml: ")
    assert "\n" not in str(refused.value)


def test_a_rig_does_not_share_its_input_dictionary() -> None:
    bodies = {"amigo": Pose.identity()}
    rig = Rig(T_body_base=bodies)
    bodies["other"] = Pose.identity()
    assert list(rig.T_body_base) == ["amigo"]


@pytest.mark.parametrize(("value", "sigma"), [(np.nan, None), (1.0, 0.0), (1.0, np.inf)])
def test_an_invalid_value_or_standard_deviation_is_refused(
    value: float, sigma: float | None
) -> None:
    with pytest.raises(InputError):
        RigValue(value, sigma)

"""Damaged rig.yaml: gives either a rig within its limits or a one-sentence refusal."""

from __future__ import annotations

import numpy as np
from hypothesis import given

from observer.errors import InputError
from observer.rig.rig_file import read_rig, rig_text

from ...damage import damaged_text, examples, hostile_text, read_or_refused

WHOLE = """mount:
  height_m: 0.41
  tilt_deg: {estimated: 5.2, sigma: 0.3}
  roll_deg: null
  forward_m: 0.05
calibration: 3f9c
T_body_base:
  amigo: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -0.15]]
models: {observer: amigo-sh, obstacle: p3dx-sh}
ports: {observer: "/dev/ttyUSB0", obstacle: "socket://192.168.1.20:8101"}
for_simulated: false
"""
WORDS = ("mount: ", "height_m: ", "sigma: ", "T_body_base: ", "ports: ", "models: ", "a: [[1]]\n")


@examples(60)
@given(damaged_text([WHOLE], WORDS) | hostile_text(WORDS))
def test_a_damaged_file_is_refused_or_gives_a_valid_rig(text: str) -> None:
    rig = read_or_refused(lambda: read_rig(text, "rig.yaml"), InputError)
    if rig is None:
        return
    for pose in rig.T_body_base.values():
        assert np.isfinite(pose.matrix).all()
        np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-5)
    written = rig_text(rig)
    assert rig_text(read_rig(written, "rig.yaml")) == written

"""Every size, offset, request and number, checked against the kernel's header by a compiler."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import pytest

from observer.sources.cameras.v4l2 import layout

STRUCTURES: dict[str, tuple[type[ctypes.Structure], dict[str, str]]] = {
    # Kernel's name: (ours, {our field: the kernel's field} where they differ).
    "v4l2_capability": (layout.Capability, {}),
    "v4l2_fmtdesc": (layout.FormatDescription, {}),
    "v4l2_pix_format": (layout.PixelFormat, {}),
    "v4l2_format": (layout.Format, {}),
    "v4l2_fract": (layout.Fraction, {}),
    "v4l2_captureparm": (layout.CaptureParameters, {}),
    "v4l2_streamparm": (layout.StreamParameters, {}),
    "v4l2_frmsize_discrete": (layout.DiscreteSize, {}),
    "v4l2_frmsize_stepwise": (layout.StepwiseSize, {}),
    "v4l2_frmsizeenum": (layout.FrameSize, {"size": "discrete"}),
    "v4l2_frmival_stepwise": (layout.StepwiseInterval, {}),
    "v4l2_frmivalenum": (layout.FrameInterval, {"interval": "discrete"}),
    "v4l2_queryctrl": (layout.ControlQuery, {}),
    "v4l2_querymenu": (layout.MenuQuery, {"item": "name"}),
    "v4l2_control": (layout.ControlValue, {}),
}
NUMBERS = {
    "VIDIOC_QUERYCAP": layout.QUERY_CAPABILITY,
    "VIDIOC_ENUM_FMT": layout.ENUMERATE_FORMATS,
    "VIDIOC_G_FMT": layout.GET_FORMAT,
    "VIDIOC_G_PARM": layout.GET_PARAMETERS,
    "VIDIOC_G_CTRL": layout.GET_CONTROL,
    "VIDIOC_S_CTRL": layout.SET_CONTROL,
    "VIDIOC_QUERYCTRL": layout.QUERY_CONTROL,
    "VIDIOC_QUERYMENU": layout.QUERY_MENU,
    "VIDIOC_ENUM_FRAMESIZES": layout.ENUMERATE_SIZES,
    "VIDIOC_ENUM_FRAMEINTERVALS": layout.ENUMERATE_INTERVALS,
    "V4L2_BUF_TYPE_VIDEO_CAPTURE": layout.BUFFER_CAPTURE,
    "V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE": layout.BUFFER_CAPTURE_MULTIPLANAR,
    "V4L2_CAP_VIDEO_CAPTURE": layout.CAN_CAPTURE,
    "V4L2_CAP_VIDEO_OUTPUT": layout.CAN_OUTPUT,
    "V4L2_CAP_VIDEO_CAPTURE_MPLANE": layout.CAN_CAPTURE_MULTIPLANAR,
    "V4L2_CAP_VIDEO_OUTPUT_MPLANE": layout.CAN_OUTPUT_MULTIPLANAR,
    "V4L2_CAP_VIDEO_M2M_MPLANE": layout.IS_CODEC_MULTIPLANAR,
    "V4L2_CAP_VIDEO_M2M": layout.IS_CODEC,
    "V4L2_CAP_META_CAPTURE": layout.CAN_CAPTURE_METADATA,
    "V4L2_CAP_DEVICE_CAPS": layout.HAS_DEVICE_CAPABILITIES,
    "V4L2_FRMSIZE_TYPE_DISCRETE": layout.DISCRETE,
    "V4L2_FRMIVAL_TYPE_DISCRETE": layout.DISCRETE,
    "V4L2_CTRL_TYPE_INTEGER": layout.TYPE_INTEGER,
    "V4L2_CTRL_TYPE_BOOLEAN": layout.TYPE_BOOLEAN,
    "V4L2_CTRL_TYPE_MENU": layout.TYPE_MENU,
    "V4L2_CTRL_TYPE_BUTTON": layout.TYPE_BUTTON,
    "V4L2_CTRL_TYPE_INTEGER64": layout.TYPE_INTEGER64,
    "V4L2_CTRL_TYPE_CTRL_CLASS": layout.TYPE_CLASS,
    "V4L2_CTRL_TYPE_STRING": layout.TYPE_STRING,
    "V4L2_CTRL_TYPE_BITMASK": layout.TYPE_BITMASK,
    "V4L2_CTRL_TYPE_INTEGER_MENU": layout.TYPE_INTEGER_MENU,
    "V4L2_CTRL_FLAG_DISABLED": layout.FLAG_DISABLED,
    "V4L2_CTRL_FLAG_GRABBED": layout.FLAG_GRABBED,
    "V4L2_CTRL_FLAG_READ_ONLY": layout.FLAG_READ_ONLY,
    "V4L2_CTRL_FLAG_INACTIVE": layout.FLAG_INACTIVE,
    "V4L2_CTRL_FLAG_WRITE_ONLY": layout.FLAG_WRITE_ONLY,
    "V4L2_CTRL_FLAG_VOLATILE": layout.FLAG_VOLATILE,
    "V4L2_CTRL_FLAG_NEXT_CTRL": layout.NEXT_CONTROL,
    "V4L2_CID_AUTO_WHITE_BALANCE": layout.AUTO_WHITE_BALANCE,
    "V4L2_CID_EXPOSURE": layout.EXPOSURE_IN_DRIVER_UNITS,
    "V4L2_CID_AUTOGAIN": layout.AUTO_GAIN,
    "V4L2_CID_GAIN": layout.GAIN,
    "V4L2_CID_POWER_LINE_FREQUENCY": layout.POWER_LINE_FREQUENCY,
    "V4L2_CID_WHITE_BALANCE_TEMPERATURE": layout.WHITE_BALANCE_TEMPERATURE,
    "V4L2_CID_EXPOSURE_AUTO": layout.AUTO_EXPOSURE,
    "V4L2_CID_EXPOSURE_ABSOLUTE": layout.EXPOSURE,
    "V4L2_CID_EXPOSURE_AUTO_PRIORITY": layout.EXPOSURE_MAY_LOWER_RATE,
    "V4L2_CID_FOCUS_ABSOLUTE": layout.FOCUS,
    "V4L2_CID_FOCUS_AUTO": layout.AUTO_FOCUS,
    "V4L2_EXPOSURE_AUTO": layout.EXPOSURE_AUTOMATIC,
    "V4L2_EXPOSURE_MANUAL": layout.EXPOSURE_MANUAL,
    "V4L2_EXPOSURE_SHUTTER_PRIORITY": layout.EXPOSURE_SHUTTER_PRIORITY,
    "V4L2_EXPOSURE_APERTURE_PRIORITY": layout.EXPOSURE_APERTURE_PRIORITY,
}


@pytest.fixture(scope="module")
def header(tmp_path_factory: pytest.TempPathFactory) -> dict[str, int]:
    """Return what the compiler says: ``sizeof X``, ``X.field``, ``sizeof X.field``, constants."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler on this machine")
    folder = tmp_path_factory.mktemp("layout")
    asked: dict[str, str] = {name: f"(unsigned long long)(unsigned int){name}" for name in NUMBERS}
    for name, (ours, renamed) in STRUCTURES.items():
        asked[f"sizeof {name}"] = f"(unsigned long long)sizeof(struct {name})"
        for field in _fields(ours):
            theirs = renamed.get(field, field)
            whole = f"((struct {name}*)0)->{theirs}"
            asked[f"{name}.{field}"] = f"(unsigned long long)offsetof(struct {name}, {theirs})"
            if field not in renamed:
                asked[f"sizeof {name}.{field}"] = f"(unsigned long long)sizeof({whole})"
    lines = [f'printf("%s=%llu\\n", "{key}", {value});' for key, value in asked.items()]
    source = folder / "layout.c"
    source.write_text(
        "#include <stdio.h>\n#include <stddef.h>\n#include <linux/videodev2.h>\n"
        "int main(void) {\n" + "\n".join(lines) + "\nreturn 0; }\n"
    )
    if "videodev2.h" in (problem := _compile(compiler, source, folder / "layout")):
        pytest.skip(f"the kernel's header cannot be compiled here: {problem.splitlines()[0]}")
    assert problem == ""
    printed = subprocess.run(
        [folder / "layout"], capture_output=True, text=True, timeout=20, check=True
    )
    pairs = (line.split("=") for line in printed.stdout.splitlines())
    return {name: int(value) for name, value in pairs}


def _compile(compiler: str, source: Path, program: Path) -> str:
    done = subprocess.run(
        [compiler, "-o", program, source], capture_output=True, text=True, timeout=60, check=False
    )
    return "" if done.returncode == 0 else done.stderr


def _fields(structure: type[ctypes.Structure]) -> list[str]:
    return [str(field[0]) for field in structure._fields_]


@pytest.mark.parametrize("name", STRUCTURES)
def test_sizes_and_offsets_match_the_kernels_header(name: str, header: dict[str, int]) -> None:
    ours, renamed = STRUCTURES[name]
    assert ctypes.sizeof(ours) == header[f"sizeof {name}"]
    for field in _fields(ours):
        place = getattr(ours, field)
        assert place.offset == header[f"{name}.{field}"], field
        if field not in renamed:
            assert place.size == header[f"sizeof {name}.{field}"], field


@pytest.mark.parametrize("name", NUMBERS)
def test_numbers_match_the_kernels_header(name: str, header: dict[str, int]) -> None:
    assert NUMBERS[name] == header[name]


def test_every_number_is_checked() -> None:
    named = {name: value for name, value in vars(layout).items() if name.isupper()}
    unchecked = {
        name
        for name, value in named.items()
        if isinstance(value, int) and value not in NUMBERS.values()
    }
    assert unchecked == set()


def test_texts_end_at_their_first_zero() -> None:
    assert layout.text_of((ctypes.c_uint8 * 8)(*b"HD\0rest")) == "HD"
    assert layout.text_of((ctypes.c_uint8 * 3)(*b"abc")) == "abc"


def test_pixel_formats_are_read_as_characters() -> None:
    assert layout.fourcc_text(0x47504A4D) == "MJPG"
    # Big-endian variants have the highest bit set.
    assert layout.fourcc_text(0x80000000 | 0x20363159) == "Y16"

"""Requests, structures and numbers of Linux's video interface, from ``<linux/videodev2.h>``.

Only what is needed to list cameras and to set their controls; images are read by OpenCV. A test
compares every size, offset and number with those that a C compiler finds in the kernel's header.
Documentation: https://docs.kernel.org/userspace-api/media/v4l/v4l2.html
"""

from __future__ import annotations

import ctypes
from ctypes import Structure, Union, c_int32, c_int64, c_uint8, c_uint32, c_void_p

# Kinds of buffers (enum v4l2_buf_type).
BUFFER_CAPTURE = 1
BUFFER_CAPTURE_MULTIPLANAR = 9

# What a node can do (V4L2_CAP_*).
CAN_CAPTURE = 0x00000001
CAN_OUTPUT = 0x00000002
CAN_CAPTURE_MULTIPLANAR = 0x00001000
CAN_OUTPUT_MULTIPLANAR = 0x00002000
IS_CODEC_MULTIPLANAR = 0x00004000
IS_CODEC = 0x00008000
CAN_CAPTURE_METADATA = 0x00800000
HAS_DEVICE_CAPABILITIES = 0x80000000

# Kinds of sizes and intervals (enum v4l2_frmsizetypes, v4l2_frmivaltypes); 2 is continuous.
DISCRETE = 1

# Kinds of controls (enum v4l2_ctrl_type).
TYPE_INTEGER = 1
TYPE_BOOLEAN = 2
TYPE_MENU = 3
TYPE_BUTTON = 4
TYPE_INTEGER64 = 5
TYPE_CLASS = 6
TYPE_STRING = 7
TYPE_BITMASK = 8
TYPE_INTEGER_MENU = 9

# Flags of controls (V4L2_CTRL_FLAG_*).
FLAG_DISABLED = 0x0001
FLAG_GRABBED = 0x0002
FLAG_READ_ONLY = 0x0004
FLAG_INACTIVE = 0x0010
FLAG_WRITE_ONLY = 0x0040
FLAG_VOLATILE = 0x0080
# Added to an id to ask for the next control after it.
NEXT_CONTROL = 0x80000000

# Controls (V4L2_CID_*).
AUTO_WHITE_BALANCE = 0x0098090C
EXPOSURE_IN_DRIVER_UNITS = 0x00980911
AUTO_GAIN = 0x00980912
GAIN = 0x00980913
POWER_LINE_FREQUENCY = 0x00980918
WHITE_BALANCE_TEMPERATURE = 0x0098091A
AUTO_EXPOSURE = 0x009A0901
EXPOSURE = 0x009A0902
EXPOSURE_MAY_LOWER_RATE = 0x009A0903
FOCUS = 0x009A090A
AUTO_FOCUS = 0x009A090C

# Items of AUTO_EXPOSURE's menu (enum v4l2_exposure_auto_type).
EXPOSURE_AUTOMATIC = 0
EXPOSURE_MANUAL = 1
EXPOSURE_SHUTTER_PRIORITY = 2
EXPOSURE_APERTURE_PRIORITY = 3

# V4L2_CID_EXPOSURE_ABSOLUTE counts in steps of 100 us.
EXPOSURE_UNIT_S = 100e-6


def _u32(names: str) -> list[tuple[str, type[c_uint32]]]:
    """Declare consecutive unsigned 32-bit fields."""
    return [(name, c_uint32) for name in names.split()]


class Capability(Structure):
    """``struct v4l2_capability``."""

    _fields_ = [
        ("driver", c_uint8 * 16),
        ("card", c_uint8 * 32),
        ("bus_info", c_uint8 * 32),
        *_u32("version capabilities device_caps"),
        ("reserved", c_uint32 * 3),
    ]


class FormatDescription(Structure):
    """``struct v4l2_fmtdesc``."""

    _fields_ = [
        *_u32("index type flags"),
        ("description", c_uint8 * 32),
        *_u32("pixelformat mbus_code"),
        ("reserved", c_uint32 * 3),
    ]


class PixelFormat(Structure):
    """``struct v4l2_pix_format``; the multiplanar one has the same first three fields."""

    _fields_ = [
        *_u32("width height pixelformat field bytesperline sizeimage colorspace priv"),
        *_u32("flags ycbcr_enc quantization xfer_func"),
    ]


class _FormatUnion(Union):
    # A member that is not declared here holds pointers, hence the alignment.
    _fields_ = [("pix", PixelFormat), ("raw_data", c_uint8 * 200), ("alignment", c_void_p)]


class Format(Structure):
    """``struct v4l2_format``."""

    _fields_ = [("type", c_uint32), ("fmt", _FormatUnion)]


class Fraction(Structure):
    """``struct v4l2_fract``."""

    _fields_ = [("numerator", c_uint32), ("denominator", c_uint32)]


class CaptureParameters(Structure):
    """``struct v4l2_captureparm``."""

    _fields_ = [
        *_u32("capability capturemode"),
        ("timeperframe", Fraction),
        *_u32("extendedmode readbuffers"),
        ("reserved", c_uint32 * 4),
    ]


class _StreamUnion(Union):
    _fields_ = [("capture", CaptureParameters), ("raw_data", c_uint8 * 200)]


class StreamParameters(Structure):
    """``struct v4l2_streamparm``."""

    _fields_ = [("type", c_uint32), ("parm", _StreamUnion)]


class DiscreteSize(Structure):
    """``struct v4l2_frmsize_discrete``."""

    _fields_ = [("width", c_uint32), ("height", c_uint32)]


class StepwiseSize(Structure):
    """``struct v4l2_frmsize_stepwise``."""

    _fields_ = [*_u32("min_width max_width step_width min_height max_height step_height")]


class _SizeUnion(Union):
    _fields_ = [("discrete", DiscreteSize), ("stepwise", StepwiseSize)]


class FrameSize(Structure):
    """``struct v4l2_frmsizeenum``."""

    _anonymous_ = ("size",)
    _fields_ = [*_u32("index pixel_format type"), ("size", _SizeUnion), ("reserved", c_uint32 * 2)]


class StepwiseInterval(Structure):
    """``struct v4l2_frmival_stepwise``."""

    _fields_ = [("min", Fraction), ("max", Fraction), ("step", Fraction)]


class _IntervalUnion(Union):
    _fields_ = [("discrete", Fraction), ("stepwise", StepwiseInterval)]


class FrameInterval(Structure):
    """``struct v4l2_frmivalenum``."""

    _anonymous_ = ("interval",)
    _fields_ = [
        *_u32("index pixel_format width height type"),
        ("interval", _IntervalUnion),
        ("reserved", c_uint32 * 2),
    ]


class ControlQuery(Structure):
    """``struct v4l2_queryctrl``."""

    _fields_ = [
        *_u32("id type"),
        ("name", c_uint8 * 32),
        ("minimum", c_int32),
        ("maximum", c_int32),
        ("step", c_int32),
        ("default_value", c_int32),
        ("flags", c_uint32),
        ("reserved", c_uint32 * 2),
    ]


class _MenuUnion(Union):
    _pack_ = 1
    _layout_ = "ms"
    _fields_ = [("name", c_uint8 * 32), ("value", c_int64)]


class MenuQuery(Structure):
    """``struct v4l2_querymenu``, which is packed."""

    _pack_ = 1
    _layout_ = "ms"
    _anonymous_ = ("item",)
    _fields_ = [*_u32("id index"), ("item", _MenuUnion), ("reserved", c_uint32)]


class ControlValue(Structure):
    """``struct v4l2_control``."""

    _fields_ = [("id", c_uint32), ("value", c_int32)]


_READ = 2
_READ_AND_WRITE = 3


def _request(direction: int, number: int, structure: type[Structure]) -> int:
    # include/uapi/asm-generic/ioctl.h: direction, size of the argument, kind, number.
    return direction << 30 | ctypes.sizeof(structure) << 16 | ord("V") << 8 | number


QUERY_CAPABILITY = _request(_READ, 0, Capability)
ENUMERATE_FORMATS = _request(_READ_AND_WRITE, 2, FormatDescription)
GET_FORMAT = _request(_READ_AND_WRITE, 4, Format)
GET_PARAMETERS = _request(_READ_AND_WRITE, 21, StreamParameters)
GET_CONTROL = _request(_READ_AND_WRITE, 27, ControlValue)
SET_CONTROL = _request(_READ_AND_WRITE, 28, ControlValue)
QUERY_CONTROL = _request(_READ_AND_WRITE, 36, ControlQuery)
QUERY_MENU = _request(_READ_AND_WRITE, 37, MenuQuery)
ENUMERATE_SIZES = _request(_READ_AND_WRITE, 74, FrameSize)
ENUMERATE_INTERVALS = _request(_READ_AND_WRITE, 75, FrameInterval)


def text_of(field: ctypes.Array[c_uint8]) -> str:
    """Return a fixed-length character field as text, up to its first zero byte."""
    return bytes(field).split(b"\0", 1)[0].decode("utf-8", "replace").strip()


def fourcc_text(code: int) -> str:
    """Return the four characters of a pixel format's code, as in ``MJPG``."""
    return (code & 0x7FFFFFFF).to_bytes(4, "little").decode("ascii", "replace").strip()

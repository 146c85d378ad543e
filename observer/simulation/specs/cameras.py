"""The two cameras, their mount and their faults."""

from __future__ import annotations

from pydantic import Field

from observer.simulation.specs.base import Fraction, Positive, SineSpec, Spec


class CameraSpec(Spec):
    """The stereo pair and its mount on the observer."""

    width: int = Field(512, ge=64, le=4096)
    height: int = Field(256, ge=64, le=4096)
    baseline_m: float = Field(0.12, gt=0, le=1)
    hfov_deg: float = Field(60.0, ge=10, le=120)
    height_m: float = Field(0.40, ge=0.05, le=3)
    tilt_deg: float = Field(5.0, ge=-60, le=60)
    forward_m: float = Field(0.05, ge=-1, le=1)


class ShakeSpec(Spec):
    """Sine motion of the camera relative to the vehicle; angles in degrees, ``up`` in metres.

    Small and fast it models a vibrating mount, large and slow the flight of an aerial vehicle.
    """

    roll: SineSpec = SineSpec()
    pitch: SineSpec = SineSpec()
    yaw: SineSpec = SineSpec()
    up: SineSpec = SineSpec()


class LensSpec(Spec):
    """Radial and tangential distortion of both lenses, OpenCV's model."""

    k1: float = Field(0.0, ge=-0.6, le=0.6)
    k2: float = Field(0.0, ge=-0.6, le=0.6)
    p1: float = Field(0.0, ge=-0.05, le=0.05)
    p2: float = Field(0.0, ge=-0.05, le=0.05)


class TiltSpec(Spec):
    """Rotation of the right camera relative to the left one, degrees about x, y and z."""

    pitch_deg: float = Field(0.0, ge=-5, le=5)
    vergence_deg: float = Field(0.0, ge=-5, le=5)
    roll_deg: float = Field(0.0, ge=-5, le=5)


class MiscalibrationSpec(TiltSpec):
    """Error of the calibration that is handed out; ``focal`` is relative."""

    focal: float = Field(0.0, ge=-0.2, le=0.2)


class FlickerSpec(Spec):
    """Brightness of the light, ``1 + amplitude sin(2 pi hz t)``."""

    amplitude: Fraction = 0.0
    hz: float = Field(2.0, gt=0, le=1000)


class SettlingSpec(Spec):
    """Settling of the automatic exposure: brightness ``1 + (gain - 1) exp(-t / time_s)``.

    Attributes:
        gain: brightness of the first image.
        again_s: instants at which the light is switched and it settles again.
    """

    gain: float = Field(1.0, gt=0, le=10)
    time_s: Positive = 0.7
    again_s: tuple[Positive, ...] = ()


class FaultSpec(Spec):
    """Faults of the cameras.

    Attributes:
        noise: standard deviation, grey levels, independent in both cameras.
        gain: the right camera is brighter by this share.
        blur_px: standard deviation of a Gaussian (defocus), pixels.
        exposure_s: exposure time, which causes motion blur; a frame's time is its middle.
        exposure_samples: number of instants that are rendered and averaged over the exposure.
        skew_s: the right camera exposes this much later, as free-running cameras do.
        skew_known: whether frames carry the right camera's time; cheap cameras stamp only the pair.
        readout_s: rolling shutter: time from the exposure of the first row to that of the last.
    """

    noise: float = Field(0.0, ge=0, le=30)
    gain: float = Field(0.0, ge=-0.9, le=2)
    flicker: FlickerSpec = FlickerSpec()
    settling: SettlingSpec = SettlingSpec()
    blur_px: float = Field(0.0, ge=0, le=20)
    exposure_s: float = Field(0.0, ge=0, le=0.5)
    exposure_samples: int = Field(5, ge=2, le=32)
    skew_s: float = Field(0.0, ge=-0.5, le=0.5)
    skew_known: bool = True
    readout_s: float = Field(0.0, ge=0, le=0.2)
    lens: LensSpec = LensSpec()
    tilt: TiltSpec = TiltSpec()
    miscalibration: MiscalibrationSpec = MiscalibrationSpec()

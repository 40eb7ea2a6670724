"""The options of an exposure: fixed-pattern maps, signals to keep, plan, chain, engine, precision."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias, TypedDict

from ..core import require_seed
from ..core.options import Option

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ..theory.plan import Plan

PERCENTILE = 95.0
"""Percentile of the lit pixels that metering exposes to SHARE of saturation; most brighter pixels do not saturate."""
SHARE = 0.7

Engine = Literal["auto", "numpy", "drjit", "cuda"]
Precision = Literal["auto", "float32", "float64"]


Gain: TypeAlias = Annotated[
    str | float | None,
    Option(
        "Gain setting of the camera; an ISO number or a name that `cameras show` lists. Default: the numbers of the "
        "camera file.",
        flag="--gain --iso",
        metavar="ISO|NAME",
        text=str,
    ),
]


class MapOptions(TypedDict, total=False):
    """Measured fixed-pattern noise."""

    maps: Annotated[
        "Mapping[str, ArrayLike] | None",
        Option(
            "Use these measured fixed-pattern noise (FPN) maps instead of those of the serial number. They are named "
            "as `fpn-maps` names them and cover this window or the whole sensor; names of offsets and read noise end "
            "in their unit, e.g. dsnu_pixel_e, dsnu_pixel_dn.",
            flag="--fpn-maps",
            metavar="FILE.npz",
            text=str,
        ),
    ]


class SensorOptions(MapOptions, total=False):
    """Options of the conversion of photons to digital numbers, also on the command line."""

    tolerance_dn: Annotated[
        float | None,
        Option(
            "Omit stages that together change no pixel value by more than this [DN]; see `plan`. The metadata lists "
            "the omitted stages. Default: omit none.",
            low=0,
            high=1e9,
            example="0.02",
        ),
    ]
    engine: Annotated[
        Engine,
        Option(
            "Engine: numpy, drjit (one compiled kernel; the same bytes as numpy in float32), cuda (the same random "
            "numbers), or auto, the faster of numpy and drjit.",
            "auto",
        ),
    ]
    precision: Annotated[
        Precision,
        Option(
            "Precision: float32, float64 (numpy only), or auto, float32 if it can count single electrons.",
            "auto",
        ),
    ]


class StartOptions(TypedDict, total=False):
    """When the first frame begins."""

    start_s: Annotated[
        float,
        Option(
            "Start of frame 0 [s], on the time axis of motion and lamp waveforms.",
            0.0,
            low=-1e9,
            high=1e9,
            example="0.5",
            panel="Frames and seeds",
        ),
    ]


class TimeOptions(StartOptions, total=False):
    """A series of frames: frame k begins at start_s + k/fps."""

    fps: Annotated[
        float | None,
        Option(
            "Frame rate [Hz]. Motion and lamp waveforms advance between frames; frames.webp is the preview. Default: "
            "all frames show one instant.",
            low=1e-6,
            high=1e9,
            example="30",
        ),
    ]
    frame_period_s: Annotated[
        float | None,
        Option(
            "Time between the starts of successive frames [s], instead of --fps.",
            low=1e-9,
            high=1e6,
            example="0.04",
        ),
    ]


class FrameOptions(SensorOptions, TimeOptions, total=False):
    """Number, seeds and kept signals of frames."""

    keep: Annotated[
        Iterable[str],
        Option(
            "Intermediate signals to return: photons, photoelectrons, dark_electrons, electrons, volts and "
            "input_referred_electrons, i.e. volts over the gain in V/e-: electrons with all read noise.",
            (),
            flag=None,
        ),
    ]
    plan: Annotated[
        "Plan | None",
        Option("A plan made by plan(). Default: the whole chain.", flag=None),
    ]
    seed: Annotated[
        int | None,
        Option(
            "Seed of the render and of temporal noise. Default: the scene file's, else 1.",
            check=require_seed,
        ),
    ]
    serial: Annotated[
        int | None,
        Option(
            "Serial number of the sensor unit, which selects its fixed-pattern noise. Default: the scene file's, else "
            "1.",
            check=require_seed,
        ),
    ]
    frames: Annotated[
        int,
        Option(
            "Number of frames; they are the pages of one TIFF.",
            1,
            low=1,
            high=2**32 - 1,
            example="8",
        ),
    ]
    first_frame: Annotated[
        int,
        Option(
            "Number of the first frame. Frame 12 is the same, whether it is made alone or after others.",
            0,
            low=0,
            high=2**32 - 1,
        ),
    ]


class ArrayOptions(TypedDict, total=False):
    """Wavelengths and position of an array of photons, and the gain setting of the camera."""

    wavelengths_nm: Annotated[
        "ArrayLike | None",
        Option("Centres of the bands of an array (H, W, B) of photons, in nm.", flag=None),
    ]
    origin: Annotated[
        tuple[int, int] | None,
        Option(
            "Sensor (row, column) of the first pixel; default: that of the photons, else (0, 0).",
            flag=None,
        ),
    ]
    gain: Gain


class ExposeOptions(FrameOptions, ArrayOptions, total=False):
    """All options of :func:`expose` and :func:`stream`."""


class ChipOptions(MapOptions, total=False):
    """Sensor unit of :func:`mitsuba_sensor.render.plugins.digital.digital` and ``raw_log_likelihood``."""

    serial: Annotated[
        int | None,
        Option(
            "Serial number of the camera, which selects its fixed-pattern noise. Default: the film's, else 1."
        ),
    ]


class GradientOptions(MapOptions, ArrayOptions, total=False):
    """All options of :func:`mitsuba_sensor.gradient.gradient.differentiable`."""

    engine: Annotated[
        Literal["drjit", "cuda"],
        Option("The compiled backend that computes the derivatives.", "drjit"),
    ]

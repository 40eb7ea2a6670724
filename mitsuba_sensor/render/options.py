"""Options of a render: samples and stop criterion, bands, size, motion, denoiser, scene parameters, variant."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypedDict

from ..core import InputError
from ..core.options import Option
from ..sensor.options import FrameOptions, Gain, StartOptions
from .samples import (
    LONGEST_NM,
    MOST_IN_ALL,
    MOST_REPEATABLE,
    MOST_SPP,
    NARROWEST_NM,
    SHORTEST_NM,
)

if TYPE_CHECKING:
    from .scene.motion import Motion


def _checked_traverse(name: str, value: object) -> object:
    from .scene.asked import checked_traverse

    return checked_traverse(name, value)


def _checked_light_groups(name: str, value: object) -> object:
    from .scene.asked import checked_light_groups

    return checked_light_groups(name, value)


def _checked_infrared(name: str, value: object) -> object:
    from .scene.asked import checked_infrared

    return checked_infrared(name, value)


def _checked_look_at(name: str, value: object) -> object:
    from .scene.asked import checked_look_at

    return checked_look_at(name, value)


def _checked_sensor(name: str, value: object) -> str:
    """Return the id or number of a sensor as text. Raises InputError."""
    if isinstance(value, str) or (isinstance(value, int) and not isinstance(value, bool)):
        return str(value)
    raise InputError(
        f"{name} is {value!r}; it must be the id of a sensor, its number from 0, or 'all'."
    )


class FileOptions(TypedDict, total=False):
    """Options for parsing a scene file: parameters, Mitsuba variant, replacements."""

    parameters: Annotated[
        Mapping[str, Any] | None,
        Option(
            "Set values for the <default> names of the scene file.",
            flag="-D",
            metavar="NAME=VALUE",
            text=list[str],
        ),
    ]
    traverse: Annotated[
        Mapping[str, float | Sequence[float]] | None,
        Option(
            "Set scene parameters by their names in mi.traverse, e.g. lamp.emitter.radiance.value for the emitter of "
            "the shape with the id lamp; several numbers are comma-separated. Repeatable.",
            flag="--traverse",
            metavar="NAME=VALUE",
            text=list[str],
            check=_checked_traverse,
        ),
    ]
    sensor: Annotated[
        str | int | None,
        Option(
            "Use this sensor of the scene file: its id, or its number from 0. all: one frame from each sensor, "
            "simultaneous, in separate folders. Default: the first sensor.",
            metavar="NAME|all",
            check=_checked_sensor,
            text=str,
        ),
    ]
    variant: Annotated[
        str | None,
        Option(
            "Render in this spectral Mitsuba variant; `doctor` lists them. Default: the current variant, else the "
            "fastest that works.",
            metavar="NAME",
            example="scalar_spectral",
        ),
    ]
    integrator: Annotated[
        Literal["path", "volpath", "volpathmis", "direct"] | None,
        Option(
            "Replace the scene's integrator by path, volpath (for media), volpathmis or direct; its depth stays. "
            "Default: the scene's integrator.",
            metavar="NAME",
        ),
    ]
    ignore_polarization: Annotated[
        bool,
        Option(
            "Render polarizers, retarders and measured_polarized as if all light were unpolarised.",
            False,
        ),
    ]
    infrared: Annotated[
        str | Sequence[str] | Mapping[str, str] | None,
        Option(
            "Reflectance of RGB colours and textures above 700 nm, if the camera sees it: hold keeps the value at 700 "
            "nm, refuse rejects the scene, IDS=MATERIAL (repeatable) uses a measured reflectance for materials or "
            "shapes with these ids, e.g. 'leaf_*=vegetation', see docs/scene.md. Default: hold.",
            flag="--infrared",
            metavar="IDS=MATERIAL",
            text=list[str],
            check=_checked_infrared,
        ),
    ]


class SceneOptions(FileOptions, total=False):
    """Options for loading a scene: unit of length, size of the image, motion, and parsing of its file."""

    scene_unit: Annotated[
        str | float | None,
        Option(
            "Unit of length of the scene: m, mm, … or a number of metres. Default: the scene file's, else m.",
            metavar="m|mm|…|METRES",
            text=str,
        ),
    ]
    width: Annotated[
        int | None,
        Option(
            "Columns of pixels of the same view; rows follow in proportion. With a lens prescription, pixels keep "
            "their size, and this is the width of a window.",
            metavar="PIXELS",
        ),
    ]
    look_at: Annotated[
        str | Mapping[str, Sequence[float]] | None,
        Option(
            "Replace the camera pose by origin and target [m] and the up direction (default 0,1,0); in Python also a "
            "dict with origin_m, target_m and up.",
            metavar="'X,Y,Z X,Y,Z'",
            check=_checked_look_at,
            text=str,
        ),
    ]
    motion: Annotated[
        "str | os.PathLike[str] | Mapping[str, Any] | Motion | None",
        Option(
            "Move parts of the scene while the shutter is open: a motion file, see docs/light-and-time.md, or "
            "rolling_fan for the scene of that name.",
            metavar="FILE.toml",
            text=str,
        ),
    ]


class RawLightOptions(TypedDict, total=False):
    """Option for undenoised light in a file."""

    raw_light: Annotated[
        bool,
        Option(
            "Undenoised light with its standard errors: a render also stores it in irradiance.exr, and an exposure "
            "uses it.",
            False,
        ),
    ]


class UnitOptions(TypedDict, total=False):
    """Options for an EXR of another program."""

    unit: Annotated[
        Literal[
            "w_per_m2_nm",
            "w_per_m2",
            "radiance_w_per_m2_sr_nm",
            "radiance_w_per_m2_sr",
            "radiance_rgb",
        ]
        | None,
        Option(
            "Content of an EXR of another program. Irradiance on the sensor: w_per_m2_nm in channels S0.*, or w_per_m2 "
            "in one channel with --wavelength-nm. Radiance before the lens: radiance_w_per_m2_sr_nm, "
            "radiance_w_per_m2_sr, or radiance_rgb in R, G, B, which become spectra.",
            metavar="UNIT",
            panel="Light of another program",
        ),
    ]
    wavelength_nm: Annotated[
        float | None,
        Option(
            "Wavelength of an EXR with one channel [nm].",
            panel="Light of another program",
            low=SHORTEST_NM,
            high=LONGEST_NM,
            example="550",
        ),
    ]
    fov_deg: Annotated[
        float | None,
        Option(
            "Horizontal field of view of the radiance [degrees], for the cos⁴ law of the lens. Default: no cos⁴.",
            panel="Light of another program",
            metavar="DEGREES",
            low=0,
            high=179,
            example="40",
        ),
    ]
    layer: Annotated[
        str | None,
        Option(
            "Read this layer or part of an EXR, e.g. ViewLayer.Combined, or this channel. Default: the channels "
            "outside layers, or the only layer with such light.",
            panel="Light of another program",
            metavar="NAME",
        ),
    ]


class RenderOptions(SceneOptions, RawLightOptions, StartOptions, total=False):
    """Options of a render besides scene, camera, exposure and seed."""

    spp: Annotated[
        int | None,
        Option(
            "Samples per pixel (light paths); rounded to full passes, at most an eighth more or less. Four times as "
            "many halve the render noise. Default: 72; without denoising up to 252, until 95 % of the lit pixels have "
            "less render noise than sensor noise.",
            low=1,
            high=MOST_IN_ALL,
            example="256",
        ),
    ]
    noise_ratio: Annotated[
        float | None,
        Option(
            "Render until the median pixel's render variance is below this fraction of its sensor variance, instead "
            "of a fixed --spp. At 0.01, the noise σ of a frame is 0.5 % too large.",
            low=1e-9,
            high=1e9,
            example="0.01",
        ),
    ]
    max_seconds: Annotated[
        float | None,
        Option("Stop rendering after this time [s].", low=0.0, metavar="SECONDS", example="60"),
    ]
    max_spp: Annotated[
        int | None,
        Option(
            "Limit the samples per pixel of a render with --noise-ratio.",
            low=2,
            high=MOST_IN_ALL,
            example="4096",
        ),
    ]
    repeatable: Annotated[
        bool,
        Option(
            "Render the same bits with any number of threads, on processors of the same kind, in passes of at most "
            f"{MOST_REPEATABLE} samples, whose dimensions are correlated.",
            False,
        ),
    ]
    wavelength_nm: Annotated[
        float | None,
        Option(
            "Render only one band around this wavelength [nm]. Default: all bands that the camera detects.",
            low=SHORTEST_NM,
            high=LONGEST_NM,
            example="550",
        ),
    ]
    bandwidth_nm: Annotated[
        float | None,
        Option(
            "Width of a spectral band [nm]. Default: the scene file's, else 10.",
            low=NARROWEST_NM,
            high=LONGEST_NM - SHORTEST_NM,
            example="10",
        ),
    ]
    spectral: Annotated[
        Literal["auto", "cube", "channels"] | None,
        Option(
            "Spectral sampling. auto: bands with the least noise in this camera's frame. cube: the same bands with the "
            "least noise in each band, for other cameras. channels: one channel for each of this camera's filters."
        ),
    ]
    light_groups: Annotated[
        str | Sequence[str] | Mapping[str, str | Sequence[str]] | None,
        Option(
            "Render groups of emitters separately, so that `expose` can change their levels later. auto: one group for "
            "each emitter with an id. NAME=PATTERN,… (repeatable): emitter ids, e.g. 'lamps=lamp_*'. The groups share "
            "the samples.",
            flag="--light-groups",
            metavar="auto|NAME=IDS",
            panel="Light groups",
            text=list[str],
            check=_checked_light_groups,
        ),
    ]
    subframes: Annotated[
        int | None,
        Option(
            "Render moving objects at this many instants of an exposure. Default: one per half pixel of motion.",
            low=1,
            high=MOST_SPP,
            example="16",
        ),
    ]
    luminance: Annotated[
        float | None,
        Option(
            "Median luminance of the image [cd/m²]; a short render finds the one factor that scales all emitters. A "
            "scene in full sunlight has 5000, an office 100. Default: emitters as in the scene.",
            low=1e-6,
            high=1e9,
            metavar="CD_M2",
            example="500",
        ),
    ]
    gain: Gain
    denoise: Annotated[
        bool | None,
        Option(
            "Denoise the light of each colour filter, to the degree that two halves of the samples confirm. Default: "
            "on if the render ends above the sensor's noise, unless each frame has its own render.",
            flag="--denoise/--no-denoise",
        ),
    ]


class FrameSeriesOptions(RenderOptions, FrameOptions, total=False):
    """All options of :func:`render_frames`."""

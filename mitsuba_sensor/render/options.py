"""The options of a render: samples and stop criterion, bands, size, motion, denoiser, scene parameters, variant."""

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
    """The id or number of a sensor, as text. Raises InputError."""
    if isinstance(value, str) or (isinstance(value, int) and not isinstance(value, bool)):
        return str(value)
    raise InputError(
        f"{name} is {value!r}; give the id of a sensor, its number from 0, or 'all'."
    )


class FileOptions(TypedDict, total=False):
    """How a scene file is parsed: parameters, Mitsuba variant, what is replaced in it."""

    parameters: Annotated[
        Mapping[str, Any] | None,
        Option(
            "Values for the <default> names of the scene file.",
            flag="-D",
            metavar="NAME=VALUE",
            text=list[str],
        ),
    ]
    traverse: Annotated[
        Mapping[str, float | Sequence[float]] | None,
        Option(
            "Set parameters of the scene by their names in mi.traverse, which begin with the id of a shape, emitter or "
            "material directly inside the scene, e.g. lamp.emitter.radiance.value=2; several numbers: 1,2,3. "
            "Repeatable.",
            flag="--traverse",
            metavar="NAME=VALUE",
            text=list[str],
            check=_checked_traverse,
        ),
    ]
    sensor: Annotated[
        str | int | None,
        Option(
            "The sensor of the scene file that takes the picture: its id, or its number from 0; all: a frame of each, "
            "of the same instant, in a folder of its own. Default: the first one.",
            metavar="NAME|all",
            check=_checked_sensor,
            text=str,
        ),
    ]
    variant: Annotated[
        str | None,
        Option(
            "Spectral Mitsuba variant, which `doctor` lists. Default: the one that is set, else the fastest that "
            "works.",
            metavar="NAME",
            example="scalar_spectral",
        ),
    ]
    integrator: Annotated[
        Literal["path", "volpath", "volpathmis", "direct"] | None,
        Option(
            "Render with this integrator of Mitsuba in place of the scene's own, with its depth: path, volpath (where "
            "light passes through media), volpathmis or direct. Default: the scene's.",
            metavar="NAME",
        ),
    ]
    ignore_polarization: Annotated[
        bool,
        Option(
            "Render polarizers, retarders and measured_polarized as they act on unpolarised light.",
            False,
        ),
    ]
    infrared: Annotated[
        str | Sequence[str] | Mapping[str, str] | None,
        Option(
            "What RGB colours and pictures reflect beyond 700 nm, where the camera sees it: hold, their value at 700 "
            "nm; refuse to render them; or IDS=MATERIAL, repeatable, a measured reflectance for materials or shapes of "
            "these ids, e.g. 'leaf_*=vegetation', see docs/scene.md. Default: hold.",
            flag="--infrared",
            metavar="IDS=MATERIAL",
            text=list[str],
            check=_checked_infrared,
        ),
    ]


class SceneOptions(FileOptions, total=False):
    """How a scene is loaded: unit of length, size of the picture, motion, and how its file is parsed."""

    scene_unit: Annotated[
        str | float | None,
        Option(
            "What a length of 1 in the scene is: m, mm, … or metres. Default: the scene file's, else m.",
            metavar="m|mm|…|METRES",
            text=str,
        ),
    ]
    width: Annotated[
        int | None,
        Option(
            "Render the same view with this many columns of pixels, and rows in proportion; behind a lens "
            "prescription, whose pixels keep their size, a window of it.",
            metavar="PIXELS",
        ),
    ]
    look_at: Annotated[
        str | Mapping[str, Sequence[float]] | None,
        Option(
            "Pose of the camera in place of the scene's: where it is and what it looks at [m], and what is up, by "
            "default 0,1,0; in Python also a dict with origin_m, target_m and up.",
            metavar="'X,Y,Z X,Y,Z'",
            check=_checked_look_at,
            text=str,
        ),
    ]
    motion: Annotated[
        "str | os.PathLike[str] | Mapping[str, Any] | Motion | None",
        Option(
            "What moves while the shutter is open: a file, see docs/light-and-time.md, or rolling_fan for the scene of "
            "that name.",
            metavar="FILE.toml",
            text=str,
        ),
    ]


class RawLightOptions(TypedDict, total=False):
    """Which light a file has, or is read from it."""

    raw_light: Annotated[
        bool,
        Option(
            "The light as it was before denoising, with its standard errors: a render keeps it beside the denoised "
            "one, also in irradiance.exr; an exposure takes it from there.",
            False,
        ),
    ]


class UnitOptions(TypedDict, total=False):
    """What the values of an EXR of another program are."""

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
            "What an EXR of another program holds: irradiance on the sensor, w_per_m2_nm in channels S0.* or w_per_m2 "
            "in one channel with --wavelength-nm; or radiance in front of the lens, radiance_w_per_m2_sr_nm, "
            "radiance_w_per_m2_sr, or radiance_rgb in R, G, B, which become spectra.",
            metavar="UNIT",
            panel="Light of another program",
        ),
    ]
    wavelength_nm: Annotated[
        float | None,
        Option(
            "Wavelength of an EXR of one channel, in nm.",
            panel="Light of another program",
            low=SHORTEST_NM,
            high=LONGEST_NM,
            example="550",
        ),
    ]
    fov_deg: Annotated[
        float | None,
        Option(
            "Horizontal field of view of such radiance, for the cos⁴ law of the lens. Default: no cos⁴.",
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
            "Layer or part of an EXR of several, e.g. ViewLayer.Combined; for one channel, its name. Default: the "
            "one outside of layers, or the only one that holds such light.",
            panel="Light of another program",
            metavar="NAME",
        ),
    ]


class RenderOptions(SceneOptions, RawLightOptions, StartOptions, total=False):
    """How a scene is rendered, beside scene, camera, exposure and seed."""

    spp: Annotated[
        int | None,
        Option(
            "Samples (light paths) per pixel over all passes; 4 × as many halve the render noise. Default: until 95 % "
            "of the lit pixels have less render noise than sensor noise, at most 64, or 256 without denoising.",
            low=1,
            high=MOST_IN_ALL,
            example="256",
        ),
    ]
    noise_ratio: Annotated[
        float | None,
        Option(
            "Instead of --spp: render until the median over the pixels of render variance over sensor variance is "
            "below this; 0.01 makes a frame 0.5 % too noisy.",
            low=1e-9,
            high=1e9,
            example="0.01",
        ),
    ]
    max_seconds: Annotated[
        float | None,
        Option(
            "Render no longer than this, in seconds.", low=0.0, metavar="SECONDS", example="60"
        ),
    ]
    max_spp: Annotated[
        int | None,
        Option(
            "With --noise-ratio: take no more samples per pixel than this.",
            low=2,
            high=MOST_IN_ALL,
            example="4096",
        ),
    ]
    repeatable: Annotated[
        bool,
        Option(
            "The same bits with any number of threads, on processors of the same kind: passes of at most "
            f"{MOST_REPEATABLE} samples.",
            False,
        ),
    ]
    wavelength_nm: Annotated[
        float | None,
        Option(
            "Render one band only, about this wavelength in nm. Default: all that the camera detects.",
            low=SHORTEST_NM,
            high=LONGEST_NM,
            example="550",
        ),
    ]
    bandwidth_nm: Annotated[
        float | None,
        Option(
            "Width of a spectral band in nm. Default: the scene file's, else 10.",
            low=NARROWEST_NM,
            high=LONGEST_NM - SHORTEST_NM,
            example="10",
        ),
    ]
    spectral: Annotated[
        Literal["auto", "cube", "channels"] | None,
        Option(
            "auto: bands with the least noise in this camera's frame; cube: the same bands with the least noise in "
            "each of them, for other cameras; channels: only what this camera's filters detect."
        ),
    ]
    light_groups: Annotated[
        str | Sequence[str] | Mapping[str, str | Sequence[str]] | None,
        Option(
            "Keep the light of groups of emitters apart, so that `expose --light` can change each of them later: auto, "
            "each emitter with an id by itself; or NAME=PATTERN,… of emitter ids, repeatable, e.g. 'lamps=lamp_*'. "
            "Each group is rendered by itself; they share the samples.",
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
            "Instants of one exposure at which moving things are rendered. Default: one per half pixel of motion.",
            low=1,
            high=MOST_SPP,
            example="16",
        ),
    ]
    luminance: Annotated[
        float | None,
        Option(
            "Median luminance of the picture [cd/m²]: a short render finds one factor for all emitters. Full sunlight "
            "gives 5000, an office 100. Default: the emitters of the scene, unscaled.",
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
            "Denoise what each colour filter detects, as far as two halves of the samples prove that better than the "
            "render itself. Default: if the render ends above the sensor's noise, unless each frame has a render of "
            "its own.",
            flag="--denoise/--no-denoise",
        ),
    ]


class FrameSeriesOptions(RenderOptions, FrameOptions, total=False):
    """All options of :func:`render_frames`."""

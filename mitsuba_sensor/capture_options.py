"""The options of a capture: those of render and exposure, and of files."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal, TypedDict

from .core import InputError
from .core.options import Option, declared
from .render.options import RawLightOptions, RenderOptions
from .sensor.frame_times import FrameTimes
from .sensor.options import FrameOptions

if TYPE_CHECKING:
    from .optics.waveform import Waveform
    from .sensor.auto_exposure import AutoExposure


def _checked_auto_exposure(name: str, value: object) -> object:
    from .sensor.auto_exposure import checked_auto_exposure

    return checked_auto_exposure(name, value)


def _checked_lights(name: str, value: object) -> object:
    from .render.light.light_sum import checked_lights

    return checked_lights(name, value)


class LevelOptions(TypedDict, total=False):
    """Levels of light groups."""

    lights: Annotated[
        Mapping[str, "float | str | Waveform"] | None,
        Option(
            "Set the level of a light group relative to its render, e.g. lamps=0.2; 0 switches it off. A waveform may "
            "follow the level: 'lamps=2 pwm(100, 0.5)' (Hz, duty cycle), sine(100, 0.3) (Hz, depth), mains(50), "
            "table(FILE.csv). Repeatable. Needs light rendered with --light-groups, which irradiance.exr keeps "
            "unchanged.",
            flag="--light",
            metavar="NAME=LEVEL",
            panel="Light groups",
            text=list[str],
            check=_checked_lights,
        ),
    ]


class LightOptions(FrameOptions, LevelOptions, total=False):
    """The options of :func:`capture` for rendered light, and of ``mitsuba-sensor expose``."""

    auto_exposure: Annotated[
        "str | AutoExposure | None",
        Option(
            "Adapt exposure time and gain between frames until their mean reaches a fraction of saturation, e.g. "
            "'target 0.18, damping 0.5, delay 2'. Further keys: shortest_s, longest_s, and mains_hz, which keeps the "
            "time at multiples of half a period. Needs --fps; the first frame has the given exposure.",
            metavar="NUMBERS",
            panel="Camera and exposure",
            text=str,
            check=_checked_auto_exposure,
        ),
    ]
    preview_gain: Annotated[
        float,
        Option(
            "Brighten frame.png by this factor, with its noise; frame.tiff is unchanged.",
            1.0,
            low=0,
            high=1e9,
            example="2",
        ),
    ]
    clean: Annotated[
        bool,
        Option(
            "Also write the expected frame and its temporal variance; clean.tiff [DN] has the fixed-pattern noise, "
            "temporal_variance.tiff is in DN²; both are float32.",
            False,
        ),
    ]
    dng: Annotated[
        bool,
        Option(
            "Also write frame.dng for raw converters; several frames get one file each, frame_0000.dng and so on. The "
            "camera must be monochrome or have red, green and blue filters in 2 × 2 tiles, and at most 16 bits.",
            False,
        ),
    ]
    page: Annotated[
        bool,
        Option(
            "Also write frame.html, a page about the first frame; it has a slider of exposure times, the expected "
            "code and noise of the pixel under the pointer, a histogram, the noise budget and notes.",
            False,
        ),
    ]


class CaptureOptions(RenderOptions, LightOptions, total=False):
    """All options of :func:`capture`, and of ``mitsuba-sensor render``."""

    render_noise: Annotated[
        Literal["shared", "per-frame"],
        Option(
            "Render once for all frames (shared), or render each frame with its own render noise (per-frame).",
            "shared",
            panel="Frames and seeds",
        ),
    ]
    no_irradiance: Annotated[bool, Option("Omit irradiance.exr, which `expose` needs.", False)]
    half: Annotated[
        bool,
        Option(
            "Write irradiance.exr in half precision, rounded by at most 0.05 % and a sixth as large. A --bandwidth-nm "
            "of 40 makes it four times smaller again.",
            False,
        ),
    ]
    aovs: Annotated[
        bool,
        Option(
            "Also write AOVs: depth, position, normals, albedo, shapes, optical flow.", False
        ),
    ]


def refuse_render_options(options: Mapping[str, object]) -> None:
    """Raise InputError for options of a render if the light is rendered already."""
    of_light = {
        one.name for kind in (LightOptions, RawLightOptions) for one in declared(kind)
    } | {"gain"}
    for one in declared(CaptureOptions):
        usual = one.option.default
        value = options.get(one.name, usual)
        is_usual = isinstance(value, type(usual)) and value == usual
        if one.name not in of_light and not is_usual:
            raise InputError(
                f"{one.name} is for the render of a scene, but this light is rendered already; omit it."
            )


def check_asked_files(options: CaptureOptions) -> None:
    """Raise InputError for contradictory options of files and frames."""
    times = FrameTimes.of(options)
    if options["auto_exposure"] is not None and times.period_s is None:
        raise InputError(
            "auto_exposure needs a series of frames; give fps, e.g. 30, or omit auto_exposure."
        )
    if options["half"] and options["no_irradiance"]:
        raise InputError(
            "half is the precision of irradiance.exr, but no_irradiance is given; omit one of them."
        )

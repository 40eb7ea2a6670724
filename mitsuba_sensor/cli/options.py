"""The options of the command line: each one's name, unit and meaning, once."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from ..core.errors import InputError

DEFAULT_CAMERA = "konnik_table1"
DEFAULT_EXPOSURE_S = 0.1
DEFAULT_TEMPERATURE_K = 298.15

Scene = Annotated[
    Path,
    typer.Argument(metavar="SCENE", help="A Mitsuba 3 scene file (.xml); its film becomes the sensor's."),
]
Light = Annotated[Path, typer.Argument(metavar="IRRADIANCE.exr", help="Light on the sensor, as `render` wrote it.")]
SceneOrLight = Annotated[
    Path, typer.Argument(metavar="SCENE_OR_EXR", help="A scene file, which is rendered first, or an irradiance.exr.")
]
Out = Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Folder for the results; made if need be.")]
Camera = Annotated[
    str,
    typer.Option("--camera", metavar="NAME", help="A name from `cameras list`, or the path of a .toml of your own."),
]
CameraName = Annotated[str, typer.Argument(metavar="NAME", help="A name from `cameras list`, or the path of a .toml.")]
ExposureS = Annotated[float, typer.Option("--exposure-s", help="How long the shutter is open, in seconds.")]
TemperatureK = Annotated[
    float, typer.Option("--temperature-k", help="Temperature of the sensor, in kelvin; 298.15 is +25 °C.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="FIELD=VALUE", help="Change a field of the camera: --set adc.bits=14. Repeatable."),
]
Seed = Annotated[int, typer.Option("--seed", help="All that chance decides: the render and the temporal noise.")]
Serial = Annotated[int, typer.Option("--serial", help="Which chip of this type: decides its fixed patterns.")]
Frames = Annotated[int, typer.Option("--frames", min=1, help="How many frames: the pages of one TIFF.")]
WavelengthNm = Annotated[
    float | None,
    typer.Option("--wavelength-nm", help="Render one band only, about this wavelength in nm. Default: all it sees."),
]
BandwidthNm = Annotated[
    float | None, typer.Option("--bandwidth-nm", help="Width of a spectral band, in nm. Default: the scene's, else 10.")
]
Spectral = Annotated[
    str | None,
    typer.Option("--spectral", help="auto (bands for this frame), cube (bands, each exact) or channels (the filters)."),
]
CameraOrScene = Annotated[
    str | None,
    typer.Option(
        "--camera",
        metavar="NAME",
        help=f"A name from `cameras list`, or a .toml of your own. Default: the scene's, else {DEFAULT_CAMERA}.",
    ),
]
ExposureOrScene = Annotated[
    float | None,
    typer.Option("--exposure-s", help=f"Shutter open, in seconds. Default: the scene's, else {DEFAULT_EXPOSURE_S}."),
]
TemperatureOrScene = Annotated[
    float | None,
    typer.Option("--temperature-k", help=f"Of the sensor, in K. Default: the scene's, else {DEFAULT_TEMPERATURE_K}."),
]
SeedOrScene = Annotated[
    int | None,
    typer.Option("--seed", help="Decides render and temporal noise. Default: the scene's, else 1."),
]
SerialOrScene = Annotated[
    int | None,
    typer.Option("--serial", help="Which chip of this type: decides its fixed patterns. Default: the scene's, else 1."),
]
NoiseRatio = Annotated[
    float | None,
    typer.Option("--noise-ratio", help="Render until the median of render over sensor variance is below: 0.01, say."),
]
MaxSeconds = Annotated[float | None, typer.Option("--max-seconds", help="But render no longer than this.")]
MaxSpp = Annotated[int | None, typer.Option("--max-spp", min=1, help="But take no more samples per pixel than this.")]
RenderNoiseMode = Annotated[
    str,
    typer.Option(
        "--render-noise",
        help="reuse one render for all frames; each frame its own; or spend its noise as part of the shot noise.",
    ),
]
Columns = Annotated[
    int | None,
    typer.Option("--columns", help="The same view in so many columns of pixels, rows in proportion: a quick look."),
]
SceneUnit = Annotated[
    str | None,
    typer.Option("--scene-unit", help="What a length of 1 in the scene is: m, mm, … Default: the scene's, else m."),
]
MotionFile = Annotated[
    Path | None, typer.Option("--motion", metavar="FILE.toml", help="What moves while the shutter is open.")
]
Subframes = Annotated[
    int | None,
    typer.Option("--subframes", min=1, help="Instants of one exposure of what moves. Default: one per half pixel."),
]
Denoise = Annotated[bool, typer.Option("--denoise", help="Smooth the light by a neural network; its bias is measured.")]
Aovs = Annotated[
    bool, typer.Option("--aovs", help="Write aovs.exr too: depth, position, normals, albedo, shapes, flow.")
]
Parameters = Annotated[
    list[str] | None,
    typer.Option("-D", metavar="NAME=VALUE", help="Set a <default> of the scene file: -D width=512. Repeatable."),
]
Samples = Annotated[
    int | None,
    typer.Option("--spp", min=1, help="Light paths per pixel; 4 × as many halve the render noise. Default: 128."),
]
Variant = Annotated[
    str | None,
    typer.Option("--variant", help="Mitsuba variant, e.g. scalar_spectral. Default: the fastest that works here."),
]
ToleranceDn = Annotated[
    float,
    typer.Option("--tolerance-dn", help="Leave out stages that together move no number by more, in DN."),
]
PatternsIn = Annotated[
    Path | None,
    typer.Option("--fpn-maps", metavar="FILE.npz", help="Measured fixed patterns, as `patterns` writes them."),
]
PatternsOut = Annotated[Path, typer.Option("-o", "--out", metavar="FILE.npz", help="The file to write.")]
MapRows = Annotated[int | None, typer.Option("--rows", min=1, help="Height of the maps. Default: the whole sensor.")]
MapColumns = Annotated[
    int | None, typer.Option("--columns", min=1, help="Width of the maps. Default: the whole sensor.")
]
PreviewGain = Annotated[
    float,
    typer.Option("--preview-gain", min=0.0, help="Brighten frame.png by this factor, noise and all; frame.tiff stays."),
]
Chain = Annotated[
    str,
    typer.Option("--chain", help="physical, or konnik2014: the paper's released code, for comparison (one band only)."),
]
Engine = Annotated[
    str,
    typer.Option("--engine", help="numpy, drjit (one kernel, the same bytes), cuda, or auto: whichever is quicker."),
]
Precision = Annotated[
    str,
    typer.Option("--precision", help="float32, float64 (numpy only), or auto: float32 while it can count electrons."),
]
StudyOut = Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Folder for the page; made if need be.")]
Again = Annotated[bool, typer.Option("--force", help="Measure anew what the folder holds already.")]
Variants = Annotated[
    list[str] | None,
    typer.Option("--variant", help="A Mitsuba variant to compare. Repeatable. Default: every one that works here."),
]
Tolerance = Annotated[
    float, typer.Option("--tolerance", help="Relative error of a pixel's light for which a setting is recommended.")
]
Seeds = Annotated[
    int, typer.Option("--seeds", min=2, help="Independent runs of each setting; their spread makes the intervals.")
]
Sides = Annotated[
    list[str] | None, typer.Option("--side", help="render or sensor: only this half. Repeatable. Default: both.")
]
StudyFrames = Annotated[
    int | None, typer.Option("--frames", min=2, help="Frames of each of the 64 devices that are measured. Default: 24.")
]
PlanDn = Annotated[float, typer.Option("--tolerance-dn", help="Of the plan that is put to the test, in DN.")]
Json = Annotated[bool, typer.Option("--json", help="Only JSON on stdout, for programs.")]


def pairs(option: str, texts: Sequence[str] | None) -> dict[str, str]:
    """["a=1", …] → {"a": "1", …}"""
    for text in texts or ():
        if not text.partition("=")[0].strip() or "=" not in text:
            raise InputError(f"{option} {text!r} has no name and value; write {option} NAME=VALUE.")
    return {text.partition("=")[0].strip(): text.partition("=")[2].strip() for text in texts or ()}

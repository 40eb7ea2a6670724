"""The options of the command line: each one's name, unit and meaning, once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

DEFAULT_CAMERA = "konnik_table1"
DEFAULT_EXPOSURE_S = 0.1
DEFAULT_TEMPERATURE_K = 298.15
DEFAULT_BANDWIDTH_NM = 10.0

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
Frames = Annotated[
    int, typer.Option("--frames", min=1, help="How many frames of the same light; the pages of one TIFF.")
]
WavelengthNm = Annotated[
    float | None,
    typer.Option("--wavelength-nm", help="Render one band only, about this wavelength in nm. Default: all it sees."),
]
BandwidthNm = Annotated[float, typer.Option("--bandwidth-nm", help="Width of a spectral band, in nm.")]
Parameters = Annotated[
    list[str] | None,
    typer.Option("-D", metavar="NAME=VALUE", help="Set a <default> of the scene file: -D width=512. Repeatable."),
]
Samples = Annotated[
    int | None,
    typer.Option("--spp", min=1, help="Light paths per pixel; 4 × as many halve the render noise. Default: 256."),
]
Variant = Annotated[
    str | None,
    typer.Option("--variant", help="Mitsuba variant, e.g. scalar_spectral. Default: the fastest that works here."),
]
ToleranceDn = Annotated[
    float,
    typer.Option("--tolerance-dn", help="Leave out stages that together move no number by more, in DN."),
]
Json = Annotated[bool, typer.Option("--json", help="Only JSON on stdout, for programs.")]

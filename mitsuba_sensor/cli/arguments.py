"""Arguments and flags that only the command line has, and what a shell proposes for values.

Paths are texts, because an empty text is no path, and ``Path("")`` is the current folder.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import Annotated

import typer

Proposals = Callable[[str], list[str]]
OUTPUT = "Output"
"""Title above the options for files and printed output."""


def one_of(values: Iterable[object]) -> Proposals:
    """Propose the values that begin with the typed text."""
    texts = [str(value) for value in values]
    return lambda incomplete: [text for text in texts if text.startswith(incomplete)]


def camera_names(incomplete: str) -> list[str]:
    """Propose included cameras."""
    from ..camera.shipped import list_cameras

    return one_of(list_cameras())(incomplete)


def scene_names(incomplete: str) -> list[str]:
    """Propose included scenes."""
    from ..files.shipped_scenes import list_scenes

    return one_of(list_scenes())(incomplete)


def scenes_and_files(incomplete: str) -> list[str]:
    """Propose included scenes and files; if no scene fits, the shell completes files itself."""
    names = scene_names(incomplete)
    return names and names + one_of(sorted(os.listdir()))(incomplete)


def camera_fields(incomplete: str) -> list[str]:
    """Propose the fields of a camera, each with the = before its value."""
    from ..camera.camera import Camera

    sections = {name: field.annotation for name, field in Camera.model_fields.items()}
    names = (
        f"{name}.{field}="
        for name, kind in sections.items()
        for field in getattr(kind, "model_fields", ())
    )
    return one_of(names)(incomplete)


def noise_source_names(incomplete: str) -> list[str]:
    """Propose the noise sources that can be switched off."""
    from ..camera.datasheet_checks import noise_sources

    return one_of(noise_sources())(incomplete)


def shell_files(incomplete: str) -> list[str]:
    """Propose nothing, so the shell completes file names."""
    return []


def argument(metavar: str, help: str, completed: Proposals = shell_files) -> object:
    """Return an argument of a command."""
    return typer.Argument(metavar=metavar, help=help, autocompletion=completed)


def output(*flags: str, help: str, metavar: str | None = None, panel: str = OUTPUT) -> object:
    """Return an option with a file name, or a switch if ``metavar`` is None."""
    return typer.Option(
        *flags, metavar=metavar, help=help, rich_help_panel=panel, autocompletion=shell_files
    )


def _out(metavar: str, help: str) -> object:
    return output("-o", "--out", metavar=metavar, help=help)


CAMERA = "Name from `cameras list`, or path of a .toml file."
Scene = Annotated[
    str,
    argument(
        "SCENE",
        "Mitsuba 3 scene file (.xml), or a name from `scenes list`. The sensor replaces the scene's film.",
        scenes_and_files,
    ),
]
IrradianceFile = Annotated[
    str, argument("IRRADIANCE.exr", "Irradiance on the sensor, written by `render`.")
]
SceneOrIrradiance = Annotated[
    str,
    argument(
        "SCENE_OR_EXR",
        "Scene to render (a file, or a name from `scenes list`), or an irradiance.exr.",
        scenes_and_files,
    ),
]
OptionalLight = Annotated[
    str | None,
    argument(
        "IRRADIANCE.exr", "Irradiance on the sensor, written by `render`; or use --electrons."
    ),
]
SceneName = Annotated[str, argument("NAME", "Name from `scenes list`.", scene_names)]
CameraName = Annotated[str, argument("NAME", CAMERA, camera_names)]
SheetCamera = Annotated[
    str | None,
    argument(
        "CAMERA",
        f"{CAMERA} With --frames, its datasheet is shown for comparison.",
        camera_names,
    ),
]
SearchText = Annotated[
    list[str] | None,
    argument("TEXT", "Only cameras with this text in name or description, e.g. imx477."),
]
NewFile = Annotated[str, argument("FILE.toml", "Camera file to write.")]
ImportedFiles = Annotated[
    list[str],
    argument(
        "FILE",
        "A libcamera tuning file (.json), a noise calibration (.json, .csv), DNGs of one camera (.dng), an EMVA "
        "1288 report (.xml), a preset of getframes (.toml, getframes:NAME), or a geometric calibration of OpenCV "
        "(.yml, .xml), ROS (.yaml) or nerfstudio (transforms.json).",
    ),
]
CopyFolder = Annotated[str, argument("DIR", "Folder for the copy; created if missing.")]
Out = Annotated[str, _out("DIR", "Folder for the results; created if missing.")]
CameraFile = Annotated[str, _out("FILE.toml", "Camera file to write.")]
MapFile = Annotated[str, _out("FILE.npz", "File to write.")]
TwinFile = Annotated[
    str, _out("FILE.toml", "Camera file to write, with FILE.npz and FILE.html next to it.")
]
BenchFolder = Annotated[
    str,
    output(
        "--frames",
        metavar="DIR",
        help="Folder of bias, dark and flat frames (TIFF, PNG, NPY, FITS, DNG, camera raw), or its bench.toml; see "
        "docs/lab.md.",
        panel="Laboratory",
    ),
]
ToleranceDn = Annotated[
    str,
    output(
        "--tolerance-dn",
        metavar="NUMBER",
        help="Largest change of a pixel value that the omitted stages may cause together [DN].",
        panel="Sensor",
    ),
]
MeanElectrons = Annotated[
    str | None,
    output(
        "--electrons",
        metavar="NUMBER",
        help="Mean photoelectrons per pixel, in uniform light.",
        panel="Light",
    ),
]
Sweep = Annotated[
    bool,
    output(
        "--sweep",
        help="Show the SNR curve instead, from 1 e- to 90 % of saturation in uniform light.",
        panel="Light",
    ),
]
Compared = Annotated[
    tuple[str, str] | None,
    output(
        "--compare",
        metavar="A B",
        help="Compare two sheets: folders that this command wrote, or camera names.",
        panel="Sheet",
    ),
]
Force = Annotated[bool, output("--force", help="Overwrite existing files.")]
Toml = Annotated[
    bool,
    output("--toml", help="Print a camera file that explains every key, to copy and change."),
]
Json = Annotated[bool, output("--json", help="Print only JSON on stdout, for programs.")]

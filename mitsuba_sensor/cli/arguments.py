"""Arguments and flags that only the command line has: files, folders, how results are shown.

Paths are texts, because an empty text is no path, and ``Path("")`` is the current folder.
"""

from collections.abc import Callable
from typing import Annotated

import typer

from .completion import camera_names, scene_names, scenes_and_files, shell_files

OUTPUT = "Output"


def _argument(
    metavar: str, help: str, completed: Callable[[str], list[str]] = shell_files
) -> object:
    return typer.Argument(metavar=metavar, help=help, autocompletion=completed)


def _out(metavar: str, help: str) -> object:
    flags = ("-o", "--out")
    return typer.Option(
        *flags, metavar=metavar, help=help, rich_help_panel=OUTPUT, autocompletion=shell_files
    )


def _switch(flag: str, help: str) -> object:
    return typer.Option(flag, help=help, rich_help_panel=OUTPUT)


Scene = Annotated[
    str,
    _argument(
        "SCENE",
        "A Mitsuba 3 scene file (.xml), or a name from `scenes list`; its film becomes the sensor's.",
        scenes_and_files,
    ),
]
IrradianceFile = Annotated[
    str, _argument("IRRADIANCE.exr", "Irradiance on the sensor, as `render` wrote it.")
]
SceneOrIrradiance = Annotated[
    str,
    _argument(
        "SCENE_OR_EXR",
        "A scene (a file, or a name from `scenes list`), which is rendered first, or an irradiance.exr.",
        scenes_and_files,
    ),
]
OptionalLight = Annotated[
    str | None,
    _argument(
        "[IRRADIANCE.exr]", "The light of a render, as `render` wrote it; or give --electrons."
    ),
]
SceneName = Annotated[str, _argument("NAME", "A name from `scenes list`.", scene_names)]
CameraName = Annotated[
    str,
    _argument("NAME", "A name from `cameras list`, or the path of a .toml.", camera_names),
]
SheetCamera = Annotated[
    str | None,
    _argument(
        "CAMERA",
        "A name from `cameras list`, or the path of a .toml; with --frames, the one whose datasheet is compared.",
        camera_names,
    ),
]
SearchText = Annotated[
    list[str] | None,
    _argument("[TEXT]...", "Only cameras with this text in name or description, e.g. imx477."),
]
NewFile = Annotated[str, _argument("FILE.toml", "The camera file to write.")]
ImportedFiles = Annotated[
    list[str],
    _argument(
        "FILE...",
        "A libcamera tuning file (.json), a noise calibration (.json, .csv), DNGs of one camera (.dng), an EMVA "
        "1288 report (.xml), a preset of getframes (.toml, getframes:NAME), or a geometric calibration of OpenCV "
        "(.yml, .xml), ROS (.yaml) or nerfstudio (transforms.json).",
    ),
]
CopyFolder = Annotated[str, _argument("DIR", "Folder for the copy; made if needed.")]
Out = Annotated[str, _out("DIR", "Folder for the results; made if needed.")]
CameraFile = Annotated[str, _out("FILE.toml", "The camera file to write.")]
MapFile = Annotated[str, _out("FILE.npz", "The file to write.")]
TwinFile = Annotated[
    str, _out("FILE.toml", "The camera file to write; FILE.npz and FILE.html beside it.")
]
BenchFolder = Annotated[
    str,
    typer.Option(
        "--frames",
        metavar="DIR",
        help="Folder of bias, dark and flat frames (TIFF, PNG, NPY, FITS, DNG, camera raw), or its bench.toml; see "
        "docs/lab.md.",
        rich_help_panel="Laboratory",
        autocompletion=shell_files,
    ),
]
ToleranceDn = Annotated[
    str,
    typer.Option(
        "--tolerance-dn",
        metavar="NUMBER",
        help="Leave out stages that together move no number by more, in DN.",
        rich_help_panel="Sensor",
    ),
]
MeanElectrons = Annotated[
    str | None,
    typer.Option(
        "--electrons",
        metavar="NUMBER",
        help="Mean photoelectrons of every pixel, in uniform light.",
        rich_help_panel="Light",
    ),
]
Sweep = Annotated[
    bool,
    typer.Option(
        "--sweep",
        help="The SNR curve instead: signal and noise at levels of uniform light, from 1 e- to 90 % of saturation.",
        rich_help_panel="Light",
    ),
]
Compared = Annotated[
    tuple[str, str] | None,
    typer.Option(
        "--compare",
        metavar="A B",
        help="Two sheets side by side: folders that this command wrote, or names of cameras.",
        rich_help_panel="Sheet",
    ),
]
Force = Annotated[bool, _switch("--force", "Overwrite existing files.")]
Toml = Annotated[
    bool, _switch("--toml", "A camera file with every key explained, to copy and change.")
]
Json = Annotated[bool, _switch("--json", "Only JSON on stdout, for programs.")]

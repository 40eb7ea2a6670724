"""Arguments and flags that only the command line has: files, folders, how results are shown.

Paths are texts, because an empty text is no path, and ``Path("")`` is the current folder.
"""

from typing import Annotated

import typer

from .completion import camera_names, scene_names, scenes_and_files, shell_files

OUTPUT = "Output"

Scene = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="A Mitsuba 3 scene file (.xml), or a name from `scenes list`; its film becomes the sensor's.",
        autocompletion=scenes_and_files,
    ),
]
IrradianceFile = Annotated[
    str,
    typer.Argument(
        metavar="IRRADIANCE.exr",
        help="Irradiance on the sensor, as `render` wrote it.",
        autocompletion=shell_files,
    ),
]
SceneOrIrradiance = Annotated[
    str,
    typer.Argument(
        metavar="SCENE_OR_EXR",
        help="A scene (a file, or a name from `scenes list`), which is rendered first, or an irradiance.exr.",
        autocompletion=scenes_and_files,
    ),
]
Out = Annotated[
    str,
    typer.Option(
        "-o",
        "--out",
        metavar="DIR",
        help="Folder for the results; made if need be.",
        rich_help_panel=OUTPUT,
        autocompletion=shell_files,
    ),
]
NewFile = Annotated[
    str,
    typer.Argument(
        metavar="FILE.toml", help="The camera file to write.", autocompletion=shell_files
    ),
]
ImportedFiles = Annotated[
    list[str],
    typer.Argument(
        metavar="FILE...",
        help="A libcamera tuning file (.json), a noise calibration (.json, .csv), DNGs of one camera (.dng), an EMVA "
        "1288 report (.xml), a preset of getframes (.toml, getframes:NAME), or a geometric calibration of OpenCV "
        "(.yml, .xml), ROS (.yaml) or nerfstudio (transforms.json).",
        autocompletion=shell_files,
    ),
]
SceneName = Annotated[
    str,
    typer.Argument(
        metavar="NAME", help="A name from `scenes list`.", autocompletion=scene_names
    ),
]
CopyFolder = Annotated[
    str,
    typer.Argument(
        metavar="DIR",
        help="Folder for the copy; made if need be.",
        autocompletion=shell_files,
    ),
]
Force = Annotated[
    bool,
    typer.Option("--force", help="Write over files that are there.", rich_help_panel=OUTPUT),
]
CameraFile = Annotated[
    str,
    typer.Option(
        "-o",
        "--out",
        metavar="FILE.toml",
        help="The camera file to write.",
        rich_help_panel=OUTPUT,
        autocompletion=shell_files,
    ),
]
CameraName = Annotated[
    str,
    typer.Argument(
        metavar="NAME",
        help="A name from `cameras list`, or the path of a .toml.",
        autocompletion=camera_names,
    ),
]
SheetCamera = Annotated[
    str | None,
    typer.Argument(
        metavar="CAMERA",
        help="A name from `cameras list`, or the path of a .toml; with --frames, the one whose datasheet is compared.",
        autocompletion=camera_names,
    ),
]
SearchText = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[TEXT]...",
        help="Only cameras with this text in name or description, e.g. imx477.",
        show_default=False,
    ),
]
MapFile = Annotated[
    str,
    typer.Option(
        "-o",
        "--out",
        metavar="FILE.npz",
        help="The file to write.",
        rich_help_panel=OUTPUT,
        autocompletion=shell_files,
    ),
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
TwinFile = Annotated[
    str,
    typer.Option(
        "-o",
        "--out",
        metavar="FILE.toml",
        help="The camera file to write; FILE.npz and FILE.html beside it.",
        rich_help_panel=OUTPUT,
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
Toml = Annotated[
    bool,
    typer.Option(
        "--toml",
        help="A camera file with every key explained, to copy and change.",
        rich_help_panel=OUTPUT,
    ),
]
Json = Annotated[
    bool,
    typer.Option("--json", help="Only JSON on stdout, for programs.", rich_help_panel=OUTPUT),
]

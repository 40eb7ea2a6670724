"""The command sheet: charts in front of a camera, every figure at every setting beside theory, on one page."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..core import InputError
from ..core.options import Option, complete, part_of
from . import arguments, options
from .app import app, err, show, show_remarks
from .help import Command
from .measuring import SimulatedFlags, how_made, refuse_beside_frames
from .options import CameraFlags, Flags, StudyFlags
from .progress import steps_bar
from .values import Flag

if TYPE_CHECKING:
    from ..bench.sheet.sheet import ChartPart, Report
    from ..camera.camera import Camera
    from ..pages.page import Study

PANEL = "Sheet"
FILES = "sheet.html", "sheet.json", "sheet.csv"
COMPARISON = "comparison.html", "comparison.json", "comparison.csv"


class SheetFlags(SimulatedFlags, total=False):
    """Flags of ``sheet``."""

    gains: Annotated[
        str | None,
        Option(
            "Gain settings, apart by commas, or all. Default: the camera as its file has it.",
            metavar="NAME,…|all",
            panel=PANEL,
        ),
    ]
    temperatures: Annotated[
        str | None,
        Option(
            f"Temperatures of the sensor in kelvin, apart by commas. Default: {options.DEFAULT_TEMPERATURE_K}.",
            metavar="KELVIN,…",
            panel=PANEL,
        ),
    ]
    charts: Annotated[
        str | None,
        Option(
            "Only these of emva, edge, star, leaves, steps, colours, grey, led, apart by commas. Default: all.",
            metavar="NAME,…",
            panel=PANEL,
        ),
    ]
    frames: Annotated[
        str | None,
        Option(
            "Measure frames of a real camera: a folder with a folder for each chart, see docs/image-quality.md.",
            metavar="DIR",
            panel=PANEL,
        ),
    ]


Compared = Annotated[
    tuple[str, str] | None,
    typer.Option(
        "--compare",
        metavar="A B",
        help="Two sheets side by side: folders that this command wrote, or names of cameras.",
        rich_help_panel=PANEL,
    ),
]


@app.command(
    cls=Command,
    epilog="Example: mitsuba-sensor sheet bayer_2mp -o sheet/; two: mitsuba-sensor sheet --compare sheet/ other/",
)
@options.flags(
    CameraFlags,
    SheetFlags,
    StudyFlags,
    without=("camera", "exposure_s", "meter", "temperature_k", "gain"),
    first=("gains", "temperatures", "charts", "frames", "compare", "out", "as_json"),
    source="",
    helps={"out": "Folder for the page and its data. Default: sheet."},
)
def sheet(
    camera: arguments.SheetCamera = None,
    compare: Compared = None,
    **flags: Flag,
) -> None:
    """Image quality of a camera on one page: what charts show at every gain and temperature, beside theory.

    Charts stand in front of a simulated camera: even light (EMVA 1288), slanted edges, a star, dead leaves, grey
    steps, a ColorChecker, a grey surface, a flickering lamp. Their light is rendered once and kept in
    ~/.cache/mitsuba-sensor.

    Writes sheet.html, sheet.json and sheet.csv; --compare writes comparison.html, comparison.json and comparison.csv.
    Exit code 1: a figure is not what theory says, of a compared sheet too.
    """
    from ..core import first_given
    from ..files.appearing import require_folder
    from ..pages.html_page import html

    asked = complete(SheetFlags, part_of(SheetFlags, flags))
    folder = first_given(flags["out"], "sheet")
    require_folder(folder)
    with steps_bar(err) as progress:
        if compare is not None:
            made = _comparison(camera, compare, asked, flags, progress)
        elif asked["frames"] is not None:
            made = _of_frames(camera, asked, flags, progress)
        else:
            made = _of_camera(camera, asked, flags, progress)
        progress(1, 1, "drawing the page")
        drawn = html(made)
    _write(made, drawn, folder, flags)
    if not made.passed:
        raise typer.Exit(1)


def _write(made: "Study", drawn: str, folder: str, flags: Flags) -> None:
    """Page, JSON and CSV in the folder, and what of it the terminal shows."""
    from ..bench.sheet.page import csv_text
    from ..files import texts
    from ..files.appearing import output_folder
    from .remarks import written
    from .study_sheet import study_sheet

    names = FILES if made.name == "sheet" else COMPARISON
    page, data, rows = names
    with output_folder(folder, names) as scratch:
        texts.write_page(scratch / page, drawn)
        texts.write_json(scratch / data, made.to_dict())
        texts.write_page(scratch / rows, csv_text(made.data["rows"]))
    as_json = bool(flags["as_json"])
    shown = study_sheet(made, str(Path(folder) / page))
    show(made.to_dict() if as_json else shown, as_json)
    show_remarks(as_json, [written(folder, names)])


def _of_camera(
    name: str | None, asked: SheetFlags, flags: Flags, progress: "Report"
) -> "Study":
    """The sheet of a simulated camera."""
    from ..bench.sheet.page import sheet_study

    if name is None:
        raise InputError(
            "sheet needs a camera; give the name of one, e.g. mitsuba-sensor sheet bayer_2mp, or --frames DIR, or "
            "--compare A B."
        )
    camera = _camera(name, flags)
    parts = _parts(camera, asked, progress)
    return sheet_study(camera.name, parts, camera=camera.name, **how_made())


def _camera(name: str, flags: Flags) -> "Camera":
    """The camera with --set, --readout and --without."""
    from ..camera.camera_file import load_camera
    from .inputs import changes_of

    camera = load_camera(name).replace(**changes_of(flags))
    if flags["readout"] is not None:
        camera = camera.at_readout(str(flags["readout"]))
    return camera.without(*flags.get("without") or ())


def _parts(camera: "Camera", asked: SheetFlags, progress: "Report") -> "list[ChartPart]":
    """What the charts show of a camera at every setting that is asked for."""
    from ..bench.sheet.charts import chosen_charts
    from ..bench.sheet.sheet import settings_of, simulated_sheet
    from ..core import first_given

    settings = settings_of(
        camera,
        _names(asked["gains"]),
        _kelvins(asked["temperatures"]),
        (first_given(asked["serial"], 1), first_given(asked["seed"], 1)),
    )
    return simulated_sheet(camera, settings, chosen_charts(_names(asked["charts"])), progress)


def _of_frames(
    name: str | None, asked: SheetFlags, flags: Flags, progress: "Report"
) -> "Study":
    """The sheet of frames from disk."""
    from ..bench.sheet.page import sheet_study
    from ..bench.sheet.sheet import sheet_of_frames

    refuse_beside_frames(asked, ("gains", "temperatures", "charts", "serial", "seed"))
    path = Path(asked["frames"] or "")
    camera = None if name is None else _camera(name, flags)
    parts = sheet_of_frames(path, camera, progress)
    title = path.resolve().name if camera is None else camera.name
    return sheet_study(title, parts, frames=str(path), **how_made())


def _comparison(
    name: str | None,
    compare: tuple[str, str],
    asked: SheetFlags,
    flags: Flags,
    progress: "Report",
) -> "Study":
    """Two sheets side by side; one of a camera is made first."""
    from ..bench.sheet.comparison import Sheet, compared, read_sheet
    from ..bench.sheet.page import sheet_study

    if name is not None or asked["frames"] is not None:
        other = "--frames" if name is None else name
        raise InputError(
            f"{other} and --compare are given; write --compare A B alone, with two folders or cameras."
        )
    on_disk = [one for one in compare if Path(one).is_dir() or Path(one).suffix == ".json"]
    sheets = {one: read_sheet(Path(one)) for one in on_disk}
    cameras = {one: _camera(one, flags) for one in compare if one not in on_disk}
    for one, camera in cameras.items():
        made = sheet_study(camera.name, _parts(camera, asked, progress))
        sheets[one] = Sheet(camera.name, made.data["rows"])
    return compared(sheets[compare[0]], sheets[compare[1]])


def _names(text: str | None) -> list[str]:
    """Names that commas separate; none where nothing is given."""
    if text is None:
        return []
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise InputError(f"{text!r} has an empty name; write names with commas between them.")
    return names


def _kelvins(text: str | None) -> list[float]:
    """Temperatures that commas separate."""
    from ..core import require
    from .inputs import tell_of_temperature

    kelvins = []
    for name in _names(text) or [str(options.DEFAULT_TEMPERATURE_K)]:
        try:
            kelvin = float(name)
        except ValueError:
            raise InputError(
                f"--temperatures has {name!r}; write numbers of kelvin, e.g. 278.15,298.15."
            ) from None
        kelvins.append(require("--temperatures", kelvin, 1.0, 1000.0, "kelvin, e.g. 298.15"))
        tell_of_temperature(kelvin)
    if len(set(kelvins)) < len(kelvins):
        raise InputError(f"--temperatures {text} has one twice; write each once.")
    return kelvins

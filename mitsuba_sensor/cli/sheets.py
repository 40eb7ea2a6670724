"""The command sheet: image quality from test charts at every setting, next to theory, on one page."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..core import InputError
from ..core.options import Option, complete, part_of
from . import arguments, options
from .app import Command, app, err
from .measuring import SimulatedFlags, how_made, publish, refuse_beside_frames
from .options import CameraFlags, Flag, Flags, StudyFlags, number
from .progress import steps_bar

if TYPE_CHECKING:
    from ..bench.sheet.sheet import ChartPart, Report
    from ..camera.camera import Camera
    from ..pages.page import Study

PANEL = "Sheet"


class SheetFlags(SimulatedFlags, total=False):
    """Options of ``sheet``."""

    gains: Annotated[
        str | None,
        Option(
            "Comma-separated gain settings, or all. Default: the numbers of the camera file.",
            metavar="NAME,…|all",
            panel=PANEL,
        ),
    ]
    temperatures: Annotated[
        str | None,
        Option(
            f"Comma-separated sensor temperatures [K]. Default: {options.DEFAULT_TEMPERATURE_K}.",
            metavar="KELVIN,…",
            panel=PANEL,
        ),
    ]
    charts: Annotated[
        str | None,
        Option(
            "Comma-separated charts of emva, edge, star, leaves, steps, colours, grey, led. Default: all.",
            metavar="NAME,…",
            panel=PANEL,
        ),
    ]
    frames: Annotated[
        str | None,
        Option(
            "Measure frames of a real camera: a folder with a folder for each chart; see docs/image-quality.md.",
            metavar="DIR",
            panel=PANEL,
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
)
def sheet(
    camera: arguments.SheetCamera = None,
    compare: arguments.Compared = None,
    **flags: Flag,
) -> None:
    """Measure the image quality of a camera with test charts, at every gain and temperature, next to theory.

    The charts of a simulated camera: uniform light (EMVA 1288), slanted edges, a star, dead leaves, grey steps, a
    ColorChecker, a grey surface and a flickering lamp. Their light is rendered once and kept in
    ~/.cache/mitsuba-sensor.

    Writes sheet.html, sheet.json and sheet.csv; --compare writes comparison.html, comparison.json and comparison.csv.
    Exit code 1: a figure disagrees with theory.
    """
    from ..bench.sheet.page import csv_text
    from ..core import first_given
    from ..files.appearing import require_folder

    asked = complete(SheetFlags, part_of(SheetFlags, flags))
    folder = first_given(flags["out"], "sheet")
    require_folder(folder)
    with steps_bar(err) as progress:
        if compare is not None:
            study = _comparison(camera, compare, asked, flags, progress)
        elif asked["frames"] is not None:
            study = _of_frames(camera, asked, flags, progress)
        else:
            study = _of_camera(camera, asked, flags, progress)
    stem = "sheet" if compare is None else "comparison"
    table = {f"{stem}.csv": csv_text(study.data["rows"])}
    publish(study, folder, stem, flags["as_json"], more=table)


def _of_camera(
    name: str | None, asked: SheetFlags, flags: Flags, progress: "Report"
) -> "Study":
    """Return the sheet of a simulated camera."""
    from ..bench.sheet.page import sheet_study
    from .inputs import camera_of

    if name is None:
        raise InputError(
            "sheet needs a camera; give its name, e.g. bayer_2mp, or --frames DIR, or two sheets (--compare A B)."
        )
    camera = camera_of({**flags, "camera": name})
    parts = _parts(camera, asked, progress)
    return sheet_study(camera.name, parts, camera=camera.name, **how_made())


def _parts(camera: "Camera", asked: SheetFlags, progress: "Report") -> "list[ChartPart]":
    """Measure the charts of a camera at every requested setting."""
    from ..bench.sheet.charts import chosen_charts
    from ..bench.sheet.sheet import settings_of, simulated_sheet
    from ..core import first_given

    unit = first_given(asked["serial"], 1), first_given(asked["seed"], 1)
    gains, kelvins = _names(asked["gains"]), _kelvins(asked["temperatures"])
    settings = settings_of(camera, gains, kelvins, unit)
    return simulated_sheet(camera, settings, chosen_charts(_names(asked["charts"])), progress)


def _of_frames(
    name: str | None, asked: SheetFlags, flags: Flags, progress: "Report"
) -> "Study":
    """Return the sheet of frames from disk."""
    from ..bench.sheet.page import sheet_study
    from ..bench.sheet.sheet import sheet_of_frames
    from .inputs import camera_of

    refuse_beside_frames(asked, ("gains", "temperatures", "charts", "serial", "seed"))
    path = Path(asked["frames"] or "")
    camera = None if name is None else camera_of({**flags, "camera": name})
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
    """Compare two sheets; the sheet of a camera is made first."""
    from ..bench.sheet.comparison import Sheet, compared, read_sheet
    from ..bench.sheet.page import sheet_study
    from .inputs import camera_of

    if name is not None or asked["frames"] is not None:
        other = "--frames" if name is None else name
        raise InputError(
            f"{other} cannot be combined with --compare; give --compare A B alone, with two folders or cameras."
        )
    on_disk = [one for one in compare if Path(one).is_dir() or Path(one).suffix == ".json"]
    sheets = {one: read_sheet(Path(one)) for one in on_disk}
    cameras = {
        one: camera_of({**flags, "camera": one}) for one in compare if one not in on_disk
    }
    for one, camera in cameras.items():
        study = sheet_study(camera.name, _parts(camera, asked, progress))
        sheets[one] = Sheet(camera.name, study.data["rows"])
    return compared(sheets[compare[0]], sheets[compare[1]])


def _names(text: str | None) -> list[str]:
    """Split comma-separated names."""
    return [name.strip() for name in (text or "").split(",") if name.strip()]


def _kelvins(text: str | None) -> list[float]:
    """Read comma-separated temperatures, each once. Raises InputError."""
    from ..core import require
    from .inputs import note_temperature

    allowed = 1.0, 1000.0, "kelvin, e.g. 278.15,298.15"
    names = _names(text) or [str(options.DEFAULT_TEMPERATURE_K)]
    kelvins = [require("--temperatures", number(name), *allowed) for name in names]
    for kelvin in (unique := [*dict.fromkeys(kelvins)]):
        note_temperature(kelvin)
    return unique

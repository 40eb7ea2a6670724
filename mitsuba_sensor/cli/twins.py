"""The command fit: frames of a camera in, its twin out: a camera file, measured maps and a page."""

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

import mitsuba_sensor as ms

from ..core import InputError
from ..core.options import Option, complete, part_of
from . import arguments, options
from .app import app, err, out, show, show_remarks
from .help import Command
from .progress import steps_bar
from .values import Flag

if TYPE_CHECKING:
    from ..camera.camera import Camera

PANEL = "Laboratory"
NEXT = "expose as this camera: mitsuba-sensor render SCENE -o out/ --camera {}"


class FitFlags(TypedDict, total=False):
    """Flags of ``fit``."""

    like: Annotated[
        str | None,
        Option(
            "Camera that gives what frames do not show: pitch, quantum efficiency, lens, conversion gain. Default: "
            "these are assumed, and the sources in the file say so.",
            metavar="NAME",
            panel=PANEL,
        ),
    ]
    bits: Annotated[
        int | None,
        Option(
            "Resolution of the ADC. Default: what the files say.", low=1, high=24, panel=PANEL
        ),
    ]
    wavelength_nm: Annotated[
        float | None,
        Option(
            "Of the light of the flat fields. Default: the manifest's.",
            low=100,
            high=1e4,
            panel=PANEL,
        ),
    ]
    force: Annotated[
        bool, Option("Write over an existing file.", False, flag="--force", panel=PANEL)
    ]


@app.command(
    cls=Command,
    epilog="Example: mitsuba-sensor fit --frames bench/ -o my_camera.toml",
)
@options.flags(FitFlags)
def fit(
    frames: arguments.BenchFolder,
    out_file: arguments.TwinFile,
    as_json: arguments.Json = False,
    **flags: Flag,
) -> None:
    """Fit the twin of a camera, a camera file with its numbers, to its bias, dark and flat frames.

    Writes FILE.toml, a camera file with the source of every number; FILE.npz, its measured maps, for
    `render --fpn-maps`; and FILE.html, the figures with 95 % intervals and how far the twin is from frames that the
    fit did not see. Of several gain settings the maps of each are in FILE.NAME.npz.
    """
    from ..bench.twin_page import twin_study
    from ..core.versions import machine, versions
    from ..files import npz, texts
    from ..files.appearing import output_folder
    from ..lab.frames.bench import read_bench
    from ..lab.twin import fit as fitted
    from ..lab.twin.fit import held_out
    from ..lab.twin.maps import maps_of
    from ..pages.html_page import html
    from .remarks import written
    from .study_sheet import study_sheet

    asked = complete(FitFlags, part_of(FitFlags, flags))
    path = _target(out_file, asked["force"])
    if asked["like"]:
        like = ms.load_camera(asked["like"])
    else:
        like = None
    with steps_bar(err) as progress:
        bench = read_bench(frames, lambda done, total: progress(done, total, "reading frames"))
        bench = bench.given(asked["bits"], asked["wavelength_nm"])
        kept, held = held_out(bench)
        progress(0, 1, "fitting")
        twin = fitted(kept)
        camera = _camera(twin.tables(like.model_dump() if like else None), path.stem)
        benches = kept.at_gain(twin.base.name), held.at_gain(twin.base.name)
        made = {
            "command": shlex.join(["mitsuba-sensor", *sys.argv[1:]]),
            "machine": machine(),
            "versions": versions(),
        }
        found = twin_study(twin, camera, benches, progress, frames=frames, **made)
    maps = {
        f"{path.stem}{_mark(one.name) if n else ''}.npz": maps_of(one)
        for n, one in enumerate(twin.settings)
    }
    files = path.name, f"{path.stem}.html", *maps
    with output_folder(path.parent, files) as scratch:
        texts.write_page(scratch / path.name, camera.to_toml())
        texts.write_page(scratch / f"{path.stem}.html", html(found))
        for name, some in maps.items():
            npz.write_fpn_maps(scratch / name, some)
    page = str(path.with_suffix(".html"))
    show(found.to_dict() if as_json else study_sheet(found, page, out.width), as_json)
    show_remarks(as_json, [written(path.parent, files), NEXT.format(path)])
    if not found.passed:
        raise typer.Exit(1)


def _target(out_file: str, force: bool) -> Path:
    from ..files.appearing import refuse_empty, require_folder

    refuse_empty(out_file, "-o", "give the name of a camera file, e.g. -o my_camera.toml")
    path = Path(out_file)
    if path.suffix != ".toml":
        raise InputError(f"{out_file} is no name of a camera file; let it end in .toml.")
    if path.exists() and not force:
        raise InputError(
            f"{out_file} is there already; give another name, or --force to write over it."
        )
    require_folder(path.parent)
    return path


def _camera(tables: dict[str, Flag], name: str) -> "Camera":
    from ..camera.camera_file import camera_from

    return camera_from(
        {**tables, "name": name, "description": "twin of a camera, fitted from its frames"},
        name,
    )


def _mark(name: str) -> str:
    return "." + "".join(c if c.isalnum() or c in "-_" else "_" for c in name)

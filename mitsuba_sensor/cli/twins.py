"""The command fit: frames of a camera in, its twin out: a camera file, measured maps and a page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple, TypedDict

import typer

import mitsuba_sensor as ms

from ..core import InputError
from ..core.options import Option, complete, part_of
from . import arguments, options
from .app import app, err, show, show_remarks
from .help import Command
from .measuring import how_made
from .progress import steps_bar
from .values import Flag

if TYPE_CHECKING:
    from ..bench.twin_page import Report
    from ..camera.camera import Camera
    from ..core import Float64Array
    from ..files.texts import Facts
    from ..lab.frames.bench import Bench
    from ..pages.page import Study

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
    fit did not see. Of several gain settings the maps of each are in FILE.NAME.npz. Frames that this program combined
    from several read-outs (readouts.tiff beside them) are fitted by read-out.
    """
    from ..files import npz, texts
    from ..files.appearing import output_folder
    from ..lab.frames.bench import readouts_of_bench
    from ..pages.html_page import html
    from .remarks import written
    from .study_sheet import study_sheet

    asked = complete(FitFlags, part_of(FitFlags, flags))
    path = _target(out_file, asked["force"])
    with steps_bar(err) as progress:
        names = readouts_of_bench(frames)
        if names:
            found = _fitted_readouts(frames, names, asked, path.stem, progress)
        else:
            found = _fitted(frames, asked, path.stem, progress)
    files = path.name, f"{path.stem}.html", *found.maps
    with output_folder(path.parent, files) as scratch:
        texts.write_page(scratch / path.name, found.camera.to_toml())
        texts.write_page(scratch / f"{path.stem}.html", html(found.study))
        for name, maps in found.maps.items():
            npz.write_fpn_maps(scratch / name, maps)
    page, shown = str(path.with_suffix(".html")), found.study.to_dict()
    show(shown if as_json else study_sheet(found.study, page), as_json)
    show_remarks(as_json, [written(path.parent, files), NEXT.format(path)])
    if not found.study.passed:
        raise typer.Exit(1)


class _Fitted(NamedTuple):
    """A twin as files.  maps : by the names of their files."""

    camera: "Camera"
    study: "Study"
    maps: "Mapping[str, Mapping[str, Float64Array]]"


def _fitted(frames: str, asked: FitFlags, stem: str, progress: "Report") -> _Fitted:
    """The twin of a camera with one read-out.  stem : of its files."""
    from ..bench.twin_page import twin_study
    from ..lab.twin import fit as fit_twin
    from ..lab.twin.fit import held_out

    kept, held = held_out(_bench(frames, asked, progress))
    progress(0, 1, "fitting")
    twin = fit_twin(kept)
    camera = _camera(twin.tables(_like(asked)), stem)
    benches = kept.at_gain(twin.base.name), held.at_gain(twin.base.name)
    study = twin_study(twin, camera, benches, progress, frames=frames, **how_made())
    maps = {f"{stem}.npz": twin.maps}
    for setting in twin.settings[1:]:
        maps[f"{stem}{_mark(setting.name)}.npz"] = setting.maps
    return _Fitted(camera, study, maps)


def _fitted_readouts(
    frames: str, names: Sequence[str], asked: FitFlags, stem: str, progress: "Report"
) -> _Fitted:
    """The twin of a camera with several read-outs, each fitted to its own frames."""
    from ..bench.twin_page import readouts_study, twin_study
    from ..lab.twin.fit import held_out
    from ..lab.twin.readouts import fit_readouts

    kept, held = dict[str, "Bench"](), dict[str, "Bench"]()
    for name in names:
        kept[name], held[name] = held_out(_bench(frames, asked, progress, name))
    progress(0, 1, "fitting")
    twins = fit_readouts(kept)
    camera = _camera(twins.tables(_like(asked)), stem)
    studies, maps = dict[str, "Study"](), dict[str, "Mapping[str, Float64Array]"]()
    for name, twin in twins.twins.items():
        benches, own = (kept[name], held[name]), camera.at_readout(name)
        studies[name] = twin_study(twin, own, benches, progress)
        maps[f"{stem}{_mark(name)}.npz"] = twin.maps
    study = readouts_study(studies, camera, frames=frames, **how_made())
    return _Fitted(camera, study, maps)


def _bench(frames: str, asked: FitFlags, progress: "Report", readout: str = "") -> "Bench":
    """The frames, or those of one read-out of them."""
    from ..lab.frames.bench import read_bench

    doing = f"reading frames {readout}".rstrip()
    bench = read_bench(frames, lambda done, total: progress(done, total, doing), readout)
    return bench.given(asked["bits"], asked["wavelength_nm"])


def _like(asked: FitFlags) -> "Facts | None":
    """The tables of the camera that gives what frames do not show."""
    if not asked["like"]:
        return None
    return ms.load_camera(asked["like"]).model_dump()


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

"""The command fit: frames of a camera in, its twin out: a camera file, measured maps and a page."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, TypedDict

import mitsuba_sensor as ms

from ..core.options import Option, complete, part_of
from . import arguments, options
from .app import app, err
from .help import Command
from .measuring import finish, how_made
from .progress import steps_bar
from .values import Flag

if TYPE_CHECKING:
    from ..bench.twin_page import Report
    from ..camera.camera import Camera
    from ..core import Float64Array
    from ..lab.frames.bench import Bench
    from ..pages.page import Study

    Maps = Mapping[str, Mapping[str, Float64Array]]

PANEL = "Laboratory"


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
        bool, Option("Overwrite an existing file.", False, flag="--force", panel=PANEL)
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
    from ..files.appearing import output_folder, require_folder
    from ..lab.frames.bench import readouts_of_bench
    from ..pages.html_page import html
    from .inputs import new_file

    asked = complete(FitFlags, part_of(FitFlags, flags))
    path = new_file(out_file, "my_camera.toml", asked["force"])
    require_folder(path.parent)
    with steps_bar(err) as progress:
        of_kind = _fitted_readouts if readouts_of_bench(frames) else _fitted
        camera, study, maps = of_kind(frames, asked, path.stem, progress)
    page = f"{path.stem}.html"
    with output_folder(path.parent, (path.name, page, *maps)) as scratch:
        texts.write_page(scratch / path.name, camera.to_toml())
        texts.write_page(scratch / page, html(study))
        for name, of_setting in maps.items():
            npz.write_fpn_maps(scratch / name, of_setting)
    after = f"expose as this camera: mitsuba-sensor render SCENE -o out/ --camera {path}"
    finish(study, path.parent, (page, path.name, *maps), as_json, [after])


def _fitted(
    frames: str, asked: FitFlags, stem: str, progress: "Report"
) -> "tuple[Camera, Study, Maps]":
    """The twin of a camera with one read-out, its study, and its maps by the names of their files."""
    from ..bench.twin_page import twin_study
    from ..lab.twin import fit as fit_twin
    from ..lab.twin.fit import held_out

    kept, held = held_out(_bench(frames, asked, progress))
    progress(0, 1, "fitting")
    twin = fit_twin(kept)
    camera = _camera(twin.tables(_like(asked)), stem)
    benches = kept.at_gain(twin.base.name), held.at_gain(twin.base.name)
    study = twin_study(twin, camera, benches, progress, frames=frames, **how_made())
    maps = {_maps_of(stem, setting.name): setting.maps for setting in twin.settings[1:]}
    return camera, study, {f"{stem}.npz": twin.maps, **maps}


def _fitted_readouts(
    frames: str, asked: FitFlags, stem: str, progress: "Report"
) -> "tuple[Camera, Study, Maps]":
    """The twin of a camera with several read-outs, each fitted to its own frames."""
    from ..bench.twin_page import readouts_study, twin_study
    from ..lab.frames.bench import readouts_of_bench
    from ..lab.twin.fit import held_out
    from ..lab.twin.readouts import fit_readouts

    split = {
        name: held_out(_bench(frames, asked, progress, name))
        for name in readouts_of_bench(frames)
    }
    progress(0, 1, "fitting")
    twins = fit_readouts({name: kept for name, (kept, _) in split.items()})
    camera = _camera(twins.tables(_like(asked)), stem)
    studies = {
        name: twin_study(twin, camera.at_readout(name), split[name], progress)
        for name, twin in twins.twins.items()
    }
    maps = {_maps_of(stem, name): twin.maps for name, twin in twins.twins.items()}
    return camera, readouts_study(studies, camera, frames=frames, **how_made()), maps


def _bench(frames: str, asked: FitFlags, progress: "Report", readout: str = "") -> "Bench":
    """The frames, or those of one read-out of them."""
    from ..lab.frames.bench import read_bench

    doing = f"reading frames {readout}".rstrip()
    bench = read_bench(frames, lambda done, total: progress(done, total, doing), readout)
    return bench.given(asked["bits"], asked["wavelength_nm"])


def _like(asked: FitFlags) -> Flag:
    """The tables of the camera that gives what frames do not show."""
    return ms.load_camera(asked["like"]).model_dump() if asked["like"] else None


def _camera(tables: dict[str, Flag], name: str) -> "Camera":
    from ..camera.camera_file import camera_from

    of_twin = {"name": name, "description": "twin of a camera, fitted from its frames"}
    return camera_from(tables | of_twin, name)


def _maps_of(stem: str, name: str) -> str:
    return f"{stem}.{''.join(c if c.isalnum() or c in '-_' else '_' for c in name)}.npz"

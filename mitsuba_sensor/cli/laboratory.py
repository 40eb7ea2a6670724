"""The commands characterize and fit: a camera, simulated or real, in the laboratory, and its twin."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias, TypedDict

import mitsuba_sensor as ms

from ..core import InputError
from ..core.options import Option, complete, part_of
from . import arguments, options
from .app import Command, app, err
from .measuring import SimulatedFlags, finish, how_made, publish, refuse_beside_frames
from .options import Flag, Flags, StudyFlags
from .progress import steps_bar

if TYPE_CHECKING:
    from ..bench.datasheet import Datasheet
    from ..bench.twin_page import Report
    from ..camera.camera import Camera
    from ..core import Float64Array
    from ..lab.frames.bench import Bench
    from ..pages.page import Study

    Maps = Mapping[str, Mapping[str, Float64Array]]

PANEL = "Laboratory"
QE_NOT_COMPARED = "η is not compared, because the wavelength of the light is unknown; give --wavelength-nm 525"

Bits: TypeAlias = Annotated[
    int | None,
    Option(
        "ADC resolution of the frames on disk [bits]. Default: from the files.",
        low=1,
        high=32,
        panel=PANEL,
    ),
]


class CharacterizeFlags(SimulatedFlags, total=False):
    """Options of ``characterize``."""

    frames: Annotated[
        str | None,
        Option(
            "Measure frames from disk: a folder of raw frames (TIFF, PNG, NPY, FITS, DNG, camera raw), or its "
            "bench.toml; see docs/lab.md. Default: simulate frames.",
            metavar="DIR",
            panel=PANEL,
        ),
    ]
    bits: Bits
    wavelength_nm: Annotated[
        float | None,
        Option(
            "Wavelength of the light [nm]. Default: from the manifest of frames on disk; for simulated frames, the "
            "wavelength of the camera's highest QE.",
            low=100,
            high=1e4,
            panel=PANEL,
        ),
    ]
    rendered: Annotated[
        bool,
        Option(
            "Render the light of the simulated frames through the lens. Default: exactly known light.",
            False,
            flag="--rendered",
            panel=PANEL,
        ),
    ]


class FitFlags(TypedDict, total=False):
    """Options of ``fit``."""

    like: Annotated[
        str | None,
        Option(
            "Camera that supplies what frames do not show: pitch, quantum efficiency, lens, conversion gain. Default: "
            "assumed values, marked in the file's sources.",
            metavar="NAME",
            panel=PANEL,
        ),
    ]
    bits: Bits
    wavelength_nm: Annotated[
        float | None,
        Option(
            "Wavelength of the flat fields' light [nm]. Default: from the manifest.",
            low=100,
            high=1e4,
            panel=PANEL,
        ),
    ]
    force: options.Forced


@app.command(
    cls=Command,
    epilog="Example: mitsuba-sensor characterize --camera bayer_2mp -o lab/; of a real one: --frames bench/ -o lab/",
)
@options.flags(
    options.CameraFlags,
    CharacterizeFlags,
    StudyFlags,
    without=("exposure_s", "meter"),
    first=("out", "as_json", "camera", "frames", "bits", "wavelength_nm", "gain"),
)
def characterize(**flags: Flag) -> None:
    """Measure a camera as EMVA 1288 requires: K, QE, noise, saturation, non-uniformity, dark current, defects.

    Without --frames, simulates the bias, dark, flat-field and gradient frames of a camera in known light and compares
    the measured figures with the datasheet. With --frames, measures frames from disk; --camera adds its datasheet.

    Writes report.html (all figures with 95 % intervals, and all plots) and report.json. Exit code 1: a figure disagrees
    with the datasheet, or is missing because frames are clipped.
    """
    from ..core import first_given
    from ..files.appearing import require_folder

    asked = complete(CharacterizeFlags, part_of(CharacterizeFlags, flags))
    folder = first_given(flags["out"], "characterize")
    require_folder(folder)
    study, remark = (_of_files if asked["frames"] else _of_simulation)(flags, asked)
    publish(study, folder, "report", flags["as_json"], [remark])


def _of_simulation(flags: Flags, asked: CharacterizeFlags) -> "tuple[Study, str]":
    """Return the study of a virtual bench and a remark on what was measured."""
    from ..bench.figures_page import characterized, figures_of
    from ..bench.virtual_bench import (
        Setup,
        best_wavelength_nm,
        field_at,
        rendered_field,
        virtual_bench,
    )
    from ..core import first_given

    if asked["bits"] is not None:
        raise InputError("--bits is for frames from disk; omit it, or give --frames.")
    camera, temperature_k = _camera(flags)
    wavelength_nm = first_given(asked["wavelength_nm"], best_wavelength_nm(camera))
    serial, seed = first_given(asked["serial"], 1), first_given(asked["seed"], 1)
    setup = Setup(temperature_k, wavelength_nm, serial, seed)
    light = rendered_field(camera) if asked["rendered"] else field_at(camera, wavelength_nm)
    with steps_bar(err) as progress:
        bench = virtual_bench(
            camera, setup, light, lambda done, total: progress(done, total, "taking frames")
        )
        measured = figures_of(bench, progress)
    kind = "rendered" if asked["rendered"] else "exact"
    about = {"camera": camera.name, **setup._asdict(), "light": kind, **how_made()}
    sheet, remarks = _datasheet(camera, temperature_k, bench, light.efficiency.tolist())
    both = ", of both photodiodes of a pixel together" if camera.sensor.dual_pixel else ""
    by_default = "" if flags["camera"] else " (default; choose another with --camera)"
    remark = (
        f"measured: simulated frames of {camera.name}{by_default}{both}, serial number {serial}, {temperature_k:g} K, "
        f"{wavelength_nm:g} nm; measure a real camera with --frames DIR"
    )
    return characterized(camera.name, measured, sheet, remarks, **about), remark


def _of_files(flags: Flags, asked: CharacterizeFlags) -> "tuple[Study, str]":
    """Return the study of frames from disk and a remark on what was measured."""
    from ..bench.figures_page import characterized, figures_of
    from ..lab.frames.bench import read_bench

    refuse_beside_frames(asked, ("rendered", "serial", "seed"))
    frames = asked["frames"] or ""
    with steps_bar(err) as progress:
        bench = read_bench(frames, lambda done, total: progress(done, total, "reading frames"))
        bench = _at_gain(bench, flags["gain"]).given(asked["bits"], asked["wavelength_nm"])
        measured = figures_of(bench, progress)
    name = Path(frames).resolve().name
    sheet: Datasheet = {}
    remarks: tuple[str, ...] = ()
    if flags["camera"]:
        (camera, temperature_k), wavelength_nm = _camera(flags), bench.wavelength_nm
        qe = None if wavelength_nm is None else camera.qe([wavelength_nm])[:, 0].tolist()
        sheet, remarks = _datasheet(camera, temperature_k, bench, qe)
        if qe is None and any("η" in part.figures for part in measured):
            remarks += (QE_NOT_COMPARED,)
        name = f"{name}, next to the datasheet of {camera.name}"
    stacks = [stack.source for stack in bench.stacks]
    about = {"frames": frames, "camera": flags["camera"] or name, "stacks": stacks}
    remark = f"measured: frames from {frames}"
    return characterized(name, measured, sheet, remarks, **about, **how_made()), remark


def _at_gain(bench: "Bench", gain: object) -> "Bench":
    """Return the stacks of one gain setting. Raises InputError if the gain is missing or unknown."""
    if gain is None and len(bench.gains) < 2:
        return bench
    if gain is None or str(gain) not in bench.gains:
        names = ", ".join(bench.gains)
        problem = "--gain is missing" if gain is None else f"--gain is {gain}"
        raise InputError(f"{problem}; the frames have the gain settings {names}; give one.")
    return bench.at_gain(str(gain))


def _camera(flags: Flags) -> "tuple[Camera, float]":
    """Return the camera at its gain setting, and the temperature [K]."""
    from .inputs import camera_and_exposure

    camera, exposure = camera_and_exposure({**flags, "exposure_s": 0.0})
    return camera, exposure.temperature_k


def _datasheet(
    camera: "Camera", temperature_k: float, bench: "Bench", efficiency: list[float] | None
) -> "tuple[Datasheet, tuple[str, ...]]":
    """Return the datasheet's figures at the exposure of the flat fields, and a remark on them.

    efficiency : QE of each filter.
    """
    from ..bench.datasheet import expected_of_filters
    from ..core import Exposure

    shortest_s = min((stack.exposure_s for stack in bench.flats), default=0.0)
    pixels = next(iter(bench.of_filters().values())).stacks[0].mean.size
    exposure = Exposure(shortest_s, temperature_k)
    remark = (
        f"datasheet: the numbers of {camera.name} at {shortest_s:g} s and {temperature_k:g} K; σ_d includes the dark "
        "current"
    )
    return expected_of_filters(camera, exposure, efficiency, pixels), (remark,)


@app.command(
    cls=Command, epilog="Example: mitsuba-sensor fit --frames bench/ -o my_camera.toml"
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
    `render --fpn-maps`; and FILE.html, the figures with 95 % intervals and a comparison of the twin with frames that
    the fit did not use. With several gain settings or readouts, each one's maps go to FILE.NAME.npz. Frames that this
    program combined from several readouts (readouts.tiff next to them) are fitted for each readout.
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
        fitted = _fitted_readouts if readouts_of_bench(frames) else _fitted
        camera, study, maps = fitted(frames, asked, path.stem, progress)
    page = f"{path.stem}.html"
    with output_folder(path.parent, (path.name, page, *maps)) as scratch:
        texts.write_page(scratch / path.name, camera.to_toml())
        texts.write_page(scratch / page, html(study))
        for name, of_setting in maps.items():
            npz.write_fpn_maps(scratch / name, of_setting)
    after = f"expose this camera: mitsuba-sensor render SCENE -o out/ --camera {path}"
    finish(study, path.parent, (page, path.name, *maps), as_json, [after])


def _fitted(
    frames: str, asked: FitFlags, stem: str, progress: "Report"
) -> "tuple[Camera, Study, Maps]":
    """Return the twin of a camera with one readout, its study, and its maps by file name."""
    from ..bench.twin_page import twin_study
    from ..lab.twin import fit as fit_twin
    from ..lab.twin.fit import held_out

    kept, held = held_out(_bench(frames, asked, progress))
    progress(0, 1, "fitting")
    twin = fit_twin(kept)
    camera = _twin_camera(twin.tables(_like(asked)), stem)
    benches = kept.at_gain(twin.base.name), held.at_gain(twin.base.name)
    study = twin_study(twin, camera, benches, progress, frames=frames, **how_made())
    maps = {_map_file(stem, setting.name): setting.maps for setting in twin.settings[1:]}
    return camera, study, {f"{stem}.npz": twin.maps, **maps}


def _fitted_readouts(
    frames: str, asked: FitFlags, stem: str, progress: "Report"
) -> "tuple[Camera, Study, Maps]":
    """Return the twin of a camera with several readouts, each fitted to its own frames."""
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
    camera = _twin_camera(twins.tables(_like(asked)), stem)
    studies = {
        name: twin_study(twin, camera.at_readout(name), split[name], progress)
        for name, twin in twins.twins.items()
    }
    maps = {_map_file(stem, name): twin.maps for name, twin in twins.twins.items()}
    return camera, readouts_study(studies, camera, frames=frames, **how_made()), maps


def _bench(frames: str, asked: FitFlags, progress: "Report", readout: str = "") -> "Bench":
    """Read the frames, or the frames of one readout."""
    from ..lab.frames.bench import read_bench

    doing = f"reading frames {readout}".rstrip()
    bench = read_bench(frames, lambda done, total: progress(done, total, doing), readout)
    return bench.given(asked["bits"], asked["wavelength_nm"])


def _like(asked: FitFlags) -> Flag:
    return ms.load_camera(asked["like"]).model_dump() if asked["like"] else None


def _twin_camera(tables: dict[str, Flag], name: str) -> "Camera":
    from ..camera.camera_file import camera_from

    of_twin = {"name": name, "description": "twin of a camera, fitted from its frames"}
    return camera_from(tables | of_twin, name)


def _map_file(stem: str, name: str) -> str:
    return f"{stem}.{''.join(c if c.isalnum() or c in '-_' else '_' for c in name)}.npz"

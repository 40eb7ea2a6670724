"""The command of the laboratory: characterize a camera, simulated or real."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..camera.shipped import DEFAULT_CAMERA
from ..core import InputError
from ..core.options import Option, complete, part_of
from . import options
from .app import app, err, show, show_remarks
from .help import Command
from .measuring import SimulatedFlags, how_made, refuse_beside_frames
from .options import Flags, StudyFlags
from .progress import steps_bar
from .values import Flag

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ..bench.datasheet import Said
    from ..camera.camera import Camera
    from ..core import Float64Array
    from ..lab.frames.bench import Bench
    from ..pages.page import Study

PANEL = "Laboratory"
PAGE, REPORT = "report.html", "report.json"


class CharacterizeFlags(SimulatedFlags, total=False):
    """Flags of ``characterize``."""

    frames: Annotated[
        str | None,
        Option(
            "Folder of raw frames of a camera (TIFF, PNG, NPY, FITS, DNG, camera raw), or its bench.toml; see "
            "docs/lab.md. Default: frames are simulated.",
            metavar="DIR",
            panel=PANEL,
        ),
    ]
    bits: Annotated[
        int | None,
        Option(
            "Of the frames on disk: resolution of the ADC. Default: what the files say.",
            low=1,
            high=32,
            panel=PANEL,
        ),
    ]
    wavelength_nm: Annotated[
        float | None,
        Option(
            "Of the light. Default: where the camera sees most; of frames on disk: the manifest's.",
            low=100,
            high=1e4,
            panel=PANEL,
        ),
    ]
    rendered: Annotated[
        bool,
        Option(
            "The light of the simulated frames passes the renderer and the lens.",
            False,
            flag="--rendered",
            panel=PANEL,
        ),
    ]


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
    source="",
    helps={
        "out": "Folder for report.html and report.json. Default: characterize.",
        "camera": "A name from `cameras list`, or the path of a .toml of your own; with --frames, the camera whose "
        f"datasheet is compared. Default: {DEFAULT_CAMERA}; with --frames none.",
    },
)
def characterize(**flags: Flag) -> None:
    """Measure a camera as EMVA 1288 does: K, QE, noise, saturation, non-uniformity, dark current, defects.

    Without --frames a camera is simulated, konnik_table1 unless --camera names another: bias, dark, flat-field and
    gradient frames in light that is exactly known. Its datasheet's figures stand beside the measured ones. With
    --frames the same is measured in frames from disk, of any camera; with --camera too, its datasheet is compared.

    Writes report.html (all figures with 95 % intervals, and all plots) and report.json. Exit code 1: a figure is not
    the datasheet's, or has no value because the frames are clipped.
    """
    from ..core import first_given
    from ..files import texts
    from ..files.appearing import output_folder, require_folder
    from ..pages.html_page import html
    from .remarks import written
    from .study_sheet import study_sheet

    asked = complete(CharacterizeFlags, part_of(CharacterizeFlags, flags))
    folder = first_given(flags["out"], "characterize")
    require_folder(folder)
    if asked["frames"]:
        made = _of_files(flags, asked)
    else:
        made = _of_simulation(flags, asked)
    with steps_bar(err, "drawing the page"), output_folder(folder, (PAGE, REPORT)) as scratch:
        texts.write_page(scratch / PAGE, html(made))
        texts.write_json(scratch / REPORT, made.to_dict())
    show(
        made.to_dict() if flags["as_json"] else study_sheet(made, str(Path(folder) / PAGE)),
        flags["as_json"],
    )
    show_remarks(
        flags["as_json"], [*_what_was_measured(flags, made), written(folder, (PAGE, REPORT))]
    )
    if not made.passed:
        raise typer.Exit(1)


def _what_was_measured(flags: Flags, made: "Study") -> "Iterator[str]":
    """Where the frames are from, and what of it nobody asked for."""
    from .inputs import NO_SCENE
    from .remarks import taken_by_default

    if flags["frames"]:
        yield f"measured: frames from {flags['frames']}"
        return
    camera, temperature_k = _camera(flags)
    both = ", of both photodiodes of a pixel together" if camera.sensor.dual_pixel else ""
    yield (
        f"measured: simulated frames of {camera.name}{both}, serial number {made.data['serial']}, at "
        f"{temperature_k:g} K in light of {made.data['wavelength_nm']:g} nm; frames of a real camera: --frames DIR"
    )
    yield from taken_by_default({**flags, "exposure_s": 0.0}, NO_SCENE, camera)


def _of_simulation(flags: Flags, asked: CharacterizeFlags) -> "Study":
    """A virtual bench, beside the datasheet that its frames are from."""
    from ..bench.figures_page import characterized, figures_of
    from ..bench.rendered_field import field_at, rendered_field
    from ..bench.virtual_bench import Setup, best_wavelength_nm, virtual_bench
    from ..core import first_given

    if asked["bits"] is not None:
        raise InputError("--bits is for frames from disk; leave it out, or give --frames.")
    camera, temperature_k = _camera(flags)
    wavelength_nm = first_given(asked["wavelength_nm"], best_wavelength_nm(camera))
    setup = Setup(
        temperature_k,
        wavelength_nm,
        first_given(asked["serial"], 1),
        first_given(asked["seed"], 1),
    )
    with steps_bar(err) as progress:
        if asked["rendered"]:
            light = rendered_field(camera)
        else:
            light = field_at(camera, wavelength_nm)
        bench = virtual_bench(
            camera, setup, light, lambda done, total: progress(done, total, "taking frames")
        )
        measured = figures_of(bench, progress)
    about = {
        "camera": camera.name,
        **setup._asdict(),
        "light": "rendered" if asked["rendered"] else "exact",
    }
    sheet = _datasheet(flags, bench, light.efficiency)
    return characterized(camera.name, measured, sheet, **about, **how_made())


def _of_files(flags: Flags, asked: CharacterizeFlags) -> "Study":
    """Frames from disk, beside the datasheet of --camera if there is one."""
    from ..bench.figures_page import characterized, figures_of
    from ..lab.frames.bench import read_bench

    refuse_beside_frames(asked, ("rendered", "serial", "seed"))
    with steps_bar(err) as progress:
        bench = read_bench(
            asked["frames"] or "", lambda done, total: progress(done, total, "reading frames")
        )
        bench = _at_gain(bench, flags["gain"]).given(asked["bits"], asked["wavelength_nm"])
        measured = figures_of(bench, progress)
    name, sheet = Path(asked["frames"] or "").resolve().name, {}
    if flags["camera"]:
        camera, wavelength_nm = _camera(flags)[0], bench.wavelength_nm
        if wavelength_nm is None:
            qe = None
        else:
            qe = camera.qe([wavelength_nm])[:, 0]
        sheet = _datasheet(flags, bench, qe)
        name = f"{name}, beside the datasheet of {camera.name}"
    about = {
        "frames": asked["frames"],
        "camera": flags["camera"] or name,
        "stacks": [stack.source for stack in bench.stacks],
    }
    return characterized(name, measured, sheet, **about, **how_made())


def _at_gain(bench: "Bench", gain: object) -> "Bench":
    """The stacks of one gain setting. Raises InputError where there are several and none is asked for."""
    if gain is None and len(bench.gains) > 1:
        raise InputError(
            f"the frames have the gain settings {', '.join(bench.gains)}; choose one by --gain."
        )
    if gain is None:
        return bench
    gain = str(gain)
    if gain not in bench.gains:
        raise InputError(
            f"--gain {gain} is none of the gain settings of the frames: {', '.join(bench.gains)}."
        )
    return bench.at_gain(gain)


def _camera(flags: Flags) -> "tuple[Camera, float]":
    """Camera at its gain setting, and temperature [K]."""
    from .inputs import camera_and_exposure

    camera, exposure = camera_and_exposure({**flags, "exposure_s": 0.0})
    return camera, exposure.temperature_k


def _datasheet(
    flags: Flags, bench: "Bench", efficiency: "Float64Array | None"
) -> "dict[str, dict[str, Said]]":
    """Figures of the datasheet in the exposure of the flat fields, by filter.  efficiency : QE of each filter."""
    from ..bench.datasheet import expected
    from ..core import Exposure

    camera, temperature_k = _camera(flags)
    exposure = Exposure(
        min((stack.exposure_s for stack in bench.flats), default=0.0), temperature_k
    )
    found = {}
    for name, part in bench.of_filters().items():
        kind = name.partition(" (")[0]  # G (2) is the second place of the filter G in the tile
        number = 0
        if kind in camera.filter_names:
            number = camera.filter_names.index(kind)
        if efficiency is None:
            qe = None
        else:
            qe = float(efficiency[number])
        found[name] = expected(camera, exposure, qe, part.stacks[0].mean.size)
    return found

"""A chart as data: its scene, its frames and its instrument; and the first steps of every instrument."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...core import Exposure, InputError, Photons
from ...core.types import Float64Array
from ...expose import expose
from ...files.texts import Facts
from ...lab.frames.bench import Bench
from ...lab.frames.stack import Stack
from ...lab.quantity import Quantity
from ..virtual_bench import FLAT_S, middle_of_sensor, mosaic
from .light import Bands, ChartLight, ChartScene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Lights = Sequence[ChartLight]
Draw = Callable[["Axes"], object]


class Setting(NamedTuple):
    """One gain and temperature of the sheet.

    camera : at its gain setting.  gain : name of the setting, empty if the camera has only one.
    temperature_k : sensor temperature [K].  serial, seed : of the sensor unit and of all temporal noise.
    """

    camera: Camera
    gain: str
    temperature_k: float
    serial: int
    seed: int

    @property
    def exposure(self) -> Exposure:
        """Exposure of all charts; the light varies."""
        return Exposure(FLAT_S, self.temperature_k)


@dataclass(frozen=True, eq=False)
class Taken:
    """Frames of a chart.

    bench : scenes are images of the chart; darks and flats are those that the instrument needs.
    facts : about the chart, as in ``chart.toml`` next to the frames of a real camera.
    ideal : noise-free images, (N, H, W), in DN or proportional to DN; None without a closed form.
    chips : noise-free images of single sensor units, which differ from the camera file.
    is_alike : True if all colour filters see the same image, so the theory of one filter holds for all.
    """

    bench: Bench
    facts: Facts = field(default_factory=dict)
    ideal: Float64Array | None = None
    chips: Sequence[Float64Array] = ()
    is_alike: bool = False


@dataclass(frozen=True, eq=False)
class Measured:
    """Results of an instrument under one colour filter: figures, drawings by title, and refusals as sentences."""

    filter_name: str
    figures: Sequence[Quantity]
    drawings: Mapping[str, Draw] = field(default_factory=dict)
    refused: Sequence[str] = ()


class Chart(NamedTuple):
    """A chart of the sheet.

    name, kind : of the chart; folders with frames of a real camera begin with ``kind``.
    scenes : the scenes to render.  frames : take frames of a setting in their light.  instrument : measures them.
    closed_form : True if closed_forms.py has the theory.  filters : colour filters that the camera needs.
    drawn : True if the instrument's result for the noise-free image is drawn as theory.
    """

    name: str
    kind: str
    title: str
    scenes: Callable[[Camera], list[ChartScene]]
    frames: Callable[[Setting, Lights], Taken]
    instrument: Callable[[Taken], list[Measured]]
    closed_form: bool = False
    filters: int = 1
    drawn: bool = True


def take(setting: Setting, light: Float64Array, bands: Bands, frames: int, kind: str) -> Stack:
    """Expose the middle of the sensor to mean photons per pixel (H, W, B).

    kind : source of the stack; another kind has other temporal noise.
    """
    camera, shape = setting.camera, light.shape[:2]
    origin = middle_of_sensor(camera, shape)
    photons = Photons(
        light, bands.wavelengths_nm, bandwidths_nm=bands.bandwidths_nm, origin=origin
    )
    seed = int(np.random.SeedSequence([setting.seed, *kind.encode()]).generate_state(1)[0])
    taken = expose(
        photons, camera, setting.exposure, frames=frames, serial=setting.serial, seed=seed
    )
    return Stack(
        taken.digital,
        setting.exposure.time_s,
        None if light.any() else 0.0,
        setting.temperature_k,
        setting.gain,
        bits=camera.adc.bits,
        tile=mosaic(camera),
        source=kind,
    )


def bench_of(
    setting: Setting,
    photons: Float64Array,
    bands: Bands,
    name: str,
    counts: tuple[int, int],
    flat: tuple[Float64Array, int] | None = None,
) -> Bench:
    """Take images of a chart, dark frames and flat fields.

    counts : number of images and of dark frames.  flat : photons and number of flat fields.
    """
    scene = take(setting, photons, bands, counts[0], name)
    dark = take(setting, 0 * photons, bands, counts[1], f"{name} dark")
    flats: tuple[Stack, ...] = ()
    if flat is not None:
        even = np.broadcast_to(flat[0], photons.shape)
        flats = (take(setting, even, bands, flat[1], f"{name} flat"),)
    return Bench((), (dark,), flats, (scene,))


def chart_shape(camera: Camera, rows: int, columns: int) -> tuple[int, int]:
    """Return the image size of a chart with this many rows and columns in each plane of the mosaic."""
    tile = len(camera.tile), len(camera.tile[0])
    return (
        min(rows, camera.sensor.rows // tile[0]) * tile[0],
        min(columns, camera.sensor.columns // tile[1]) * tile[1],
    )


def frames_and_black(stacks: Sequence[Stack], bench: Bench) -> tuple[Stack, Float64Array]:
    """Return the first stack and the mean dark frame (H, W). Raises InputError if sizes differ or one is missing."""
    if not stacks or not bench.darks:
        missing = "dark frames" if stacks else "frames of the chart"
        raise InputError(
            f"the folder has no {missing}; add them, with names that begin with scene and dark."
        )
    frames, dark = stacks[0], bench.darks[0]
    if frames.shape != dark.shape:
        raise InputError(
            f"{frames.source} has {frames.shape[0]} × {frames.shape[1]} pixels, {dark.source} has {dark.shape[0]} × "
            f"{dark.shape[1]}; take dark frames of the same size."
        )
    return frames, dark.mean


def without_black(stacks: Sequence[Stack], bench: Bench) -> Float64Array:
    """Return the mean of the first stack minus the mean dark frame."""
    frames, black = frames_and_black(stacks, bench)
    return np.asarray(frames.mean - black)


def step_of(bench: Bench) -> tuple[int, int]:
    """Return the pitch of one plane of the mosaic, down and across [pixels]."""
    tile = next(iter((*bench.scenes, *bench.stacks))).tile or (("",),)
    return len(tile), len(tile[0])


def each_filter(
    taken: Taken,
    measure: Callable[[Bench, tuple[int, int]], tuple[Sequence[Quantity], dict[str, Draw]]],
) -> list[Measured]:
    """Measure each plane of the mosaic, or report its refusal.

    measure : returns figures and drawings from the frames of a plane and its place in the tile.
    """
    places, measured = np.ndindex(step_of(taken.bench)), list[Measured]()
    for (name, bench), place in zip(taken.bench.of_filters().items(), places, strict=True):
        if taken.is_alike and measured:  # the same image, sampled at other places: within 2e-4
            measured.append(replace(measured[0], filter_name=name))
            continue
        try:
            measured.append(Measured(name, *measure(bench, place)))
        except InputError as error:
            measured.append(Measured(name, (), refused=(str(error),)))
    return measured


def planes_of_filters(bench: Bench) -> dict[str, Float64Array]:
    """Return the image under each colour filter, the mean of its planes."""
    planes: dict[str, list[Float64Array]] = {}
    for name, part in bench.of_filters().items():
        of_filter = planes.setdefault(name.partition(" (")[0], [])
        of_filter.append(without_black(part.scenes, part))
    return {name: np.asarray(np.mean(of_filter, axis=0)) for name, of_filter in planes.items()}

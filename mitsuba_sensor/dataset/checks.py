"""A dataset file checked before anything is made: its samples counted, its scenes parsed, its growth allowed."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import cast

import numpy as np

from ..camera.sensor_size import check_on_sensor
from ..core import Exposure, InputError
from ..core.options import complete
from ..files.memory import whole_memory_bytes
from ..output.dng import check_dng
from ..render.load.half_pupil import check_halves
from ..render.options import RenderOptions
from ..render.passes.prepared import prepare
from ..render.passes.stop_criterion import check_options
from ..render.scene.asked import AskedGroups
from ..render.scene.light_groups import LightGroup, parts_of_light
from ..render.variants import restores_variant
from .file import MOST_SAMPLES, DatasetFile
from .keys import canonical
from .make import camera_of, parsed_scene, scene_options
from .plan import DatasetPlan, Place, Task
from .sweep import ends, evenly_chosen, whole_values
from .values import check_value

MOST_CHECKED = 200
"""Lights that are looked at, evenly chosen of each scene; of a dataset with more the others are checked by the run."""
MOST_LOADED = 20
"""Tasks whose scenes are loaded, because nothing but that says whether they can be rendered."""
LOADED_FOR = Exposure(0.01)
NO_PIXELS = "description", "licence"
"""Of a dataset file, what may be another text without another dataset."""
BYTES_OF_PIXEL, BYTES_OF_CODE = 24, 2
"""Of what is in memory at least: mean, variance and light; and of a code of each frame."""


def check_scenes(plan: DatasetPlan) -> None:
    """Parse each scene with its different settings, each once, and load some. Raises InputError where one cannot be
    rendered. What only a render finds, as a scene without light, it does not find.

    A scene is loaded for what only Mitsuba knows: names of parameters, what moves, a lens. One that ends Mitsuba when
    it is loaded ends a plan, too; any other is only parsed, so that a run goes on.
    """
    parsed, loaded = set[str](), set[str]()
    for scene, sweep in enumerate(plan.sweeps):
        lights = evenly_chosen(range(sweep.lights), max(MOST_CHECKED // len(plan.sweeps), 1))
        for light in lights:
            for task in plan.tasks_at(Place(scene, light)):
                config, camera = task.config, task.lead["camera"]
                sizes = {name: np.size(x) for name, x in config["traverse"].items()}
                lens = camera["lens"] if camera["lens"].get("prescription") else None
                of_load = [sizes, config.get("motion"), lens]
                to_load = canonical([task.scene_file, *of_load])
                asked = map(config.get, ("parameters", "integrator", "scene_unit", "sensor"))
                width = config["render"]["width"]
                to_parse = canonical([to_load, *asked, width, camera["sensor"], camera["lens"]])
                if to_parse in parsed:
                    continue
                parsed.add(to_parse)
                is_loaded = any(of_load) and to_load not in loaded and len(loaded) < MOST_LOADED
                if is_loaded:
                    loaded.add(to_load)
                check_scene(plan, task, is_loaded)


@restores_variant
def check_scene(plan: DatasetPlan, task: Task, is_loaded: bool) -> None:
    """Raise InputError where a scene cannot be rendered as a task of a plan asks for, or its samples cannot be made.

    is_loaded : whether the scene is loaded, too.
    """
    try:
        options = scene_options(task)
        chosen = complete(RenderOptions, options)
        check_options(chosen)
        parsed = parsed_scene(task, options)
        parsed.settings.metres(options["scene_unit"])
        camera = camera_of(task.lead)  # all that share a light have a sensor of this size
        shape, origin = parsed.film_area(camera, options["width"])
        check_on_sensor("the film", shape, origin, camera)
        check_halves(parsed, camera)
        _check_memory(shape, max([1, *whole_values(plan.file, "frames")]))
        if "dng" in task.lead["outputs"]:
            check_dng(camera, shape)
        asked = cast(AskedGroups | None, chosen["light_groups"])
        _check_lights(plan, parts_of_light(parsed, asked, camera))
        if is_loaded:
            still: RenderOptions = {**options, "noise_ratio": None, "max_spp": None, "spp": 1}
            prepare(parsed, camera, LOADED_FOR, **still)
    except InputError as error:
        raise InputError(f"scene {task.scene!r} of the dataset: {error}") from None


def _check_lights(plan: DatasetPlan, groups: Sequence[LightGroup]) -> None:
    """Raise InputError where light varies that the scene has no group of.  groups : that it has."""
    known = [group.name for group in groups if group.half_pupil is None]
    for name in plan.file.varied:
        kind, _, group = name.partition(".")
        if kind == "lights" and group not in known:
            has = f"the light groups of the scene are {', '.join(known)}"
            if not known:
                has = 'light_groups is not in [render]; give light_groups = "auto" there'
            raise InputError(f"{name} is varied, and {has}.")


def _check_memory(shape: tuple[int, int], frames: int) -> None:
    """Raise InputError for pictures that this machine has no memory for."""
    rows, columns = shape
    needed = rows * columns * (BYTES_OF_PIXEL + frames * BYTES_OF_CODE)
    if needed > (there := whole_memory_bytes()):
        raise InputError(
            f"a sample has {columns} × {rows} pixels and frames is {frames}: {needed / 1e9:.3g} GB, and this machine "
            f"has {there / 1e9:.3g} GB of memory; take a smaller width or fewer frames, and vary repetition for more "
            "samples of the same settings."
        )


@dataclass
class Counts:
    """How many there are.  by_scene : lights and samples of each scene.  by_split : samples of each split."""

    tasks: int = 0
    samples: int = 0
    by_scene: dict[str, list[int]] = field(default_factory=dict)
    by_split: dict[str, int] = field(default_factory=dict)


def checked_counts(
    plan: DatasetPlan, each: Callable[[Task], object] = lambda task: None
) -> Counts:
    """All samples counted. Raises InputError for values that cannot be, and for two samples that are one.

    each : called with every task.
    """
    _check_draws(plan.file)
    _check_size(plan)
    found, keys, last_light = Counts(), array("Q"), ""
    for task in plan.tasks():
        of_scene = found.by_scene.setdefault(task.scene, [0, 0])
        of_scene[0] += task.light_key != last_light
        of_scene[1] += len(task.samples)
        last_light = task.light_key
        each(task)
        found.tasks += 1
        found.samples += len(task.samples)
        for sample in task.samples:
            keys.append(int(sample.key[:16], 16))
            found.by_split[sample.split] = found.by_split.get(sample.split, 0) + 1
    ordered = np.sort(np.frombuffer(keys, np.uint64)) if keys else np.zeros(0, np.uint64)
    if (same := ordered[1:][ordered[1:] == ordered[:-1]]).size:
        _refuse_equal(plan, f"{same[0]:016x}")
    return found


def _check_size(plan: DatasetPlan) -> None:
    """Raise InputError for more samples than can be counted one by one, if no split leaves any out."""
    serials = max(
        len(plan.splits.serials(split, row, camera))
        for split in plan.splits.names
        for row in plan.sweeps[0].rows
        for camera in range(len(plan.file.cameras))
    )
    lights = sum(sweep.lights // sweep.groups * sweep.draws for sweep in plan.sweeps)
    exposures = max(sweep.cells_of_exposure for sweep in plan.sweeps)
    samples = lights * exposures * len(plan.pairs) * serials
    if samples > MOST_SAMPLES:
        raise InputError(
            f"the dataset has {samples} samples; it can have at most {MOST_SAMPLES}: make several datasets, or draw "
            "values at random instead of every combination."
        )


def _refuse_equal(plan: DatasetPlan, key: str) -> None:
    """Raise InputError with both places of samples whose keys begin so."""
    samples = (sample for task in plan.tasks() for sample in task.samples)
    first, second = (
        ", ".join(f"{name} {value}" for name, value in x.values.items() if name != "pose")
        for x in islice((x for x in samples if x.key.startswith(key)), 2)
    )
    raise InputError(
        f"two samples are the same ({first}; and {second}); leave one of the scenes, poses, cameras, rows or values "
        "out, give views another time_s, or vary repetition for another sample of the same settings."
    )


def _check_draws(file: DatasetFile) -> None:
    """Raise InputError for a value that a law can draw and that cannot be."""
    laws = file.random.values.items() if file.random else ()
    for name, law in laws:
        for value in ends(law, file.random.draws if file.random else 1):
            check_value(name, value)


def growth_refused(old: DatasetFile, new: DatasetFile) -> str:
    """What of a dataset file is not as it was, where that is more than what may grow: scenes, cameras, rows, values of
    the grid and draws may come to those that are there. An empty text where nothing else is."""
    changed = []
    for name in DatasetFile.model_fields:
        before, now = getattr(old, name), getattr(new, name)
        grows = name in NO_PIXELS
        if name in ("scenes", "cameras", "list"):
            grows = bool(before) and all(one in now for one in before)
        elif name == "grid" and before.keys() == now.keys():
            grows = all({*map(repr, before[x])} <= {*map(repr, now[x])} for x in before)
        elif name == "random" and before and now:
            grows = before.values == now.values and before.draws <= now.draws
        if before != now and not grows:
            changed.append(f"[{name}]" if name in ("render", "splits") else name)
    return ", ".join(changed)

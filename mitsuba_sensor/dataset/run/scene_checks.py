"""The scenes of a dataset, checked before anything is made, by what a run would do with them but for the render."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from ...camera.sensor_size import check_on_sensor
from ...core import Exposure, InputError
from ...core.options import complete
from ...files.memory import whole_memory_bytes
from ...output.dng import check_dng
from ...render.options import RenderOptions
from ...render.passes.prepared import prepare
from ...render.passes.stop_criterion import check_options
from ...render.scene.asked_groups import AskedGroups
from ...render.scene.half_pupil import check_halves
from ...render.scene.light_groups import LightGroup, parts_of_light
from ...render.variants import restores_variant
from ..plan.planned import DatasetPlan, PlannedView, evenly_chosen
from ..plan.sweep import possible_values
from ..store.keys import canonical
from .view_render import camera_of, parsed_scene, scene_options

MOST_CHECKED = 200
"""Views that are looked at, evenly chosen of each scene; of a dataset with more the others are checked by the run."""
MOST_LOADED = 20
"""Views whose scenes are loaded, because nothing but that says whether they can be rendered."""
LOADED_FOR = Exposure(0.01)
BYTES_OF_PIXEL, BYTES_OF_CODE = 24, 2
"""Of what is in memory at least: mean, variance and light; and of a code of each frame."""


def check_scenes(plan: DatasetPlan) -> None:
    """Parse each scene with its different settings, each once, and load some. Raises InputError where one cannot be
    rendered. What only a render finds, as a scene without light, it does not find."""
    parsed, loaded = set[str](), set[str]()
    for scene in plan.scenes:
        most = max(MOST_CHECKED // (len(plan.scenes) * len(scene.shared)), 1)
        lights = evenly_chosen(range(scene.sweep.lights), most)
        for view in plan.first_views(scene, lights):
            to_load = _asked_of_load(view)
            is_new = bool(to_load) and to_load not in loaded and len(loaded) < MOST_LOADED
            asked = _asked(view)
            if is_new or asked not in parsed:
                parsed.add(asked)
                loaded.add(to_load)
                check_scene(plan, view, is_new)


def _asked(view: PlannedView) -> str:
    """What the check of a view depends on."""
    camera = view.lead["camera"]
    sensors, lens = camera["sensor"], camera["lens"]
    halves = {
        "half_pupil": lens.get("half_pupil"),
        "is_traced": lens.get("prescription") is not None,
    }
    width = view.config["render"]["width"]
    parameters = view.config["parameters"]
    scene = {"file": view.scene_file, "integrator": view.config["integrator"]}
    scene |= {"unit": view.config["scene_unit"], "sensor": view.config.get("sensor")}
    asked = {"parameters": parameters, "width": width, "sensors": sensors, **halves}
    return canonical({**scene, **asked})


def _asked_of_load(view: PlannedView) -> str:
    """What a scene is loaded for: names of its parameters in Mitsuba, what moves, a lens; empty if for nothing.

    A scene that ends Mitsuba when it is loaded ends a plan, too; any other is only parsed, so that a run goes on.
    """
    lens, traverse = view.lead["camera"]["lens"], view.config["traverse"]
    numbers = {
        name: len(x) if isinstance(x, list | tuple) else 1 for name, x in traverse.items()
    }
    asked = {"traverse": numbers, "motion": view.config.get("motion")}
    if lens.get("prescription") is not None:
        asked["lens"] = lens
    if any(asked.values()):
        return canonical({"file": view.scene_file, **asked})
    return ""


@restores_variant
def check_scene(plan: DatasetPlan, view: PlannedView, is_loaded: bool) -> None:
    """Raise InputError where a scene cannot be rendered as a view of a plan asks for, or its samples cannot be made.

    is_loaded : whether the scene is loaded, too.
    """
    try:
        options = scene_options(view)
        chosen = complete(RenderOptions, options)
        check_options(chosen)
        parsed = parsed_scene(view, options)
        parsed.settings.metres(options["scene_unit"])
        camera = camera_of(view.lead)  # all that share a light have a sensor of this size
        shape, origin = parsed.film_area(camera, options["width"])
        check_on_sensor("the film", shape, origin, camera)
        check_halves(parsed, camera)
        _check_memory(shape, max([1, *_wholes(plan, "frames")]))
        if "dng" in view.lead["outputs"]:
            check_dng(camera, shape)
        asked = cast(AskedGroups | None, chosen["light_groups"])
        _check_lights(plan, parts_of_light(parsed, asked, camera))
        if is_loaded:
            still: RenderOptions = {**options, "noise_ratio": None, "max_spp": None, "spp": 1}
            prepare(parsed, camera, LOADED_FOR, **still)
    except InputError as error:
        raise InputError(f"scene {view.scene!r} of the dataset: {error}") from None


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


def _wholes(plan: DatasetPlan, name: str) -> list[int]:
    """The whole numbers that something can be."""
    return [value for value in possible_values(plan.file, name) if isinstance(value, int)]


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

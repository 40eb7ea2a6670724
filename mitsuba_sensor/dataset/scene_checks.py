"""The scenes of a dataset, checked before anything is made: parameters, sizes of film and sensor, halves of pupils."""

from __future__ import annotations

from ..camera.sensor_size import check_on_sensor
from ..core import InputError
from ..render.scene.film_and_view import film_area
from ..render.scene.half_pupil import check_halves
from ..render.scene.scene_settings import parse
from ..render.variants import restores_variant
from .keys import canonical
from .make import camera_of, scene_options
from .planned import DatasetPlan, PlannedView, evenly_chosen

MOST_CHECKED = 200
"""Views that are looked at, evenly chosen of each scene; of a dataset with more the others are checked by the run."""


def check_scenes(plan: DatasetPlan) -> None:
    """Parse each scene with its different settings, each once. Raises InputError where one cannot be rendered."""
    known = set[str]()
    for scene in plan.scenes:
        most = max(MOST_CHECKED // (len(plan.scenes) * len(scene.shared)), 1)
        lights = evenly_chosen(range(scene.sweep.lights), most)
        for view in plan.first_views(scene, lights):
            asked = _asked(view)
            if asked not in known:
                known.add(asked)
                check_scene(view)


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
    asked = {"parameters": parameters, "width": width, "sensors": sensors, **halves}
    return canonical({**scene, **asked})


@restores_variant
def check_scene(view: PlannedView) -> None:
    """Raise InputError where the scene has no such parameter, a sensor is smaller than the film, or dual pixels
    see through a pinhole."""
    try:
        options = scene_options(view)
        parsed = parse(view.scene_file, options)
        camera = camera_of(view.lead)  # all that share a light have a sensor of this size
        shape, origin = film_area(parsed.file, camera, options["width"])
        check_on_sensor("the film", shape, origin, camera)
        check_halves(parsed.file, parsed.settings, camera)
    except InputError as error:
        raise InputError(f"scene {view.scene!r} of the dataset: {error}") from None

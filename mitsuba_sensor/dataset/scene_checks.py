"""The scenes of a dataset, checked before anything is made: their parameters, and the size of film and sensor."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ..camera.camera import Camera
from ..camera.sensor_size import check_on_sensor
from ..core import InputError
from ..render.scene.film_and_view import film_area
from ..render.scene.scene_settings import parse
from ..render.variants import restores_variant
from .keys import canonical
from .make import camera_of, scene_options
from .planned import PlannedView

MOST_CHECKED = 200
"""Different settings of scenes that are parsed; of a dataset with more of them, the others are checked by the run."""


class SceneChecks:
    """Parses each scene with each of its settings once."""

    def __init__(self) -> None:
        self._known = set[str]()

    def checked(self, views: Iterable[PlannedView]) -> Iterator[PlannedView]:
        """The views as they are. Raises InputError at the first one that cannot be rendered."""
        for view in views:
            asked = _asked(view)
            if asked not in self._known and len(self._known) < MOST_CHECKED:
                self._known.add(asked)
                check_scene(view)
            yield view


def _asked(view: PlannedView) -> str:
    """What the check of a view depends on."""
    sensors = [sample.config["camera"]["sensor"] for sample in view.samples]
    width = view.config["render"]["width"]
    parameters = view.config["parameters"]
    scene = {"file": view.scene_file, "integrator": view.config["integrator"]}
    return canonical({**scene, "parameters": parameters, "width": width, "sensors": sensors})


@restores_variant
def check_scene(view: PlannedView) -> None:
    """Raise InputError where the scene of a view has no such parameter, or a sensor is smaller than the film."""
    try:
        options = scene_options(view)
        parsed = parse(view.scene_file, options)
        for sample in view.samples:
            camera: Camera = camera_of(sample.config)
            shape, origin = film_area(parsed.file, camera, options["width"])
            check_on_sensor("the film", shape, origin, camera)
    except InputError as error:
        raise InputError(f"scene {view.scene!r} of the dataset: {error}") from None

"""Makes our plugins known to Mitsuba, whichever of the two packages is imported first; imports Mitsuba never.

``import mitsuba_sensor`` calls :func:`watch`: one finder goes into ``sys.meta_path`` where Mitsuba is not imported
yet. The finder looks at the import of ``mitsuba`` alone and takes itself out once Mitsuba is loaded. It is all that an
import of this package changes in a process (docs/scene.md).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

from ...core.llvm import guarded_import


def watch() -> None:
    """Register the plugins in Mitsuba now if it is imported, else when it is."""
    if (mi := sys.modules.get("mitsuba")) is not None:
        register(mi)
    elif not any(isinstance(finder, AfterMitsuba) for finder in sys.meta_path):
        sys.meta_path.insert(0, AfterMitsuba())


def register(mi: ModuleType) -> None:
    """Register the plugins in the variant that is set and in all that will be set."""
    mi.detail.add_variant_callback(_register)  # a set: the same function is kept once
    if mi.variant() is not None:
        _register(None, mi.variant())


class AfterMitsuba:
    """On sys.meta_path: finds Mitsuba as Python does, and registers the plugins once it is loaded."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Of Mitsuba alone."""
        spec = PathFinder.find_spec(fullname, path, target) if fullname == "mitsuba" else None
        if spec is None or spec.loader is None:
            return None
        load = spec.loader.exec_module

        def load_and_register(module: ModuleType) -> None:
            with guarded_import():
                load(module)
            if self in sys.meta_path:
                sys.meta_path.remove(self)
            register(sys.modules["mitsuba"])  # which has put another module into its place

        spec.loader.exec_module = load_and_register  # type: ignore[method-assign]
        return spec


def _register(_before: str | None, _now: str | None) -> None:
    """The plugins themselves are imported when a scene has one of them."""
    mi = sys.modules["mitsuba"]

    def film(props: Any) -> Any:
        from .plugins import photosensor

        return photosensor(props)

    def sensor(props: Any) -> Any:
        from .plugins import camera

        return camera(props)

    def integrator(props: Any) -> Any:
        from .raw_film import raw_frame

        return raw_frame(props)

    mi.register_integrator("raw_frame", integrator)
    mi.register_film("photosensor", film)
    mi.register_sensor("camera", sensor)


def register_plugins() -> None:
    """Register the two plugins in the variant that is set and in all that will be set. May be repeated.

    ::

        ms.register_plugins()
        mi.set_variant("llvm_ad_spectral")
        scene = mi.load_file("photosensor.xml")

    Importing this package does it, where Python finds Mitsuba by itself.
    """
    from ..variants import mitsuba

    register(mitsuba())

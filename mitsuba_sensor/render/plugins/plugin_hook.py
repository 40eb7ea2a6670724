"""Registers the plugins in Mitsuba, whichever package is imported first, without importing Mitsuba.

``import mitsuba_sensor`` calls :func:`watch`, which puts a finder into ``sys.meta_path`` if Mitsuba is not imported
yet. The finder handles only the import of ``mitsuba`` and removes itself afterwards. An import of this package changes
nothing else in a process (docs/scene.md).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

from ...core.llvm import guarded_import


def watch() -> None:
    """Register the plugins in Mitsuba, now or when it is imported."""
    if (mi := sys.modules.get("mitsuba")) is not None:
        register(mi)
    elif not any(isinstance(finder, AfterMitsuba) for finder in sys.meta_path):
        sys.meta_path.insert(0, AfterMitsuba())


def register(mi: ModuleType) -> None:
    """Register the plugins in the current variant and in all later variants."""
    mi.detail.add_variant_callback(_register)  # a set: the same function is kept once
    if mi.variant() is not None:
        _register(None, mi.variant())


class AfterMitsuba:
    """A finder in sys.meta_path that registers the plugins when Mitsuba is loaded."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of Mitsuba; None for any other module."""
        spec = PathFinder.find_spec(fullname, path, target) if fullname == "mitsuba" else None
        if spec is None or spec.loader is None:
            return None
        load = spec.loader.exec_module

        def load_and_register(module: ModuleType) -> None:
            with guarded_import():
                load(module)
            if self in sys.meta_path:
                sys.meta_path.remove(self)
            register(sys.modules["mitsuba"])  # Mitsuba has replaced its module

        spec.loader.exec_module = load_and_register  # type: ignore[method-assign]
        return spec


def _register(_before: str | None, _now: str | None) -> None:
    """Register factories that import the plugins when a scene uses them."""
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
    """Register the plugins in the current variant and in all later variants. Repeated calls have no effect.

    ::

        ms.register_plugins()
        mi.set_variant("llvm_ad_spectral")
        scene = mi.load_file("photosensor.xml")

    Importing this package calls it automatically if Python finds Mitsuba.
    """
    from ..variants import mitsuba

    register(mitsuba())

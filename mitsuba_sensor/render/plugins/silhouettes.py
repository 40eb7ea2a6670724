"""Lets the projective integrators of Mitsuba 3.9.1 differentiate silhouettes into a film of bands.

``direct_projective`` and ``prb_projective`` add the change by a moving silhouette with ``ImageBlock.put(pos,
wavelengths, value, …)``, which converts it to RGB and raises an error for a film of bands. For such a film, the block
receives the channels that the film prepares from the same sample. Other films are unchanged.
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ...core import Array
from ...core.llvm import drjit
from ..variants import MitsubaObject, mitsuba

METHODS = "render_primarily_visible_silhouette", "render_indirect_silhouette"


def splat_silhouettes_in_bands() -> None:
    """Patch the class of the projective integrators once."""
    base = importlib.import_module("mitsuba.python.ad.integrators.common").PSIntegrator
    for name in METHODS:
        method = getattr(base, name)
        if not hasattr(method, "__wrapped__"):
            setattr(base, name, _in_bands(method))


def _in_bands(method: Callable[..., MitsubaObject]) -> Callable[..., MitsubaObject]:
    @functools.wraps(method)
    def render(
        self: object,
        scene: MitsubaObject,
        sensor: MitsubaObject,
        *others: object,
        **options: object,
    ) -> MitsubaObject:
        mi, film = mitsuba(), sensor.film()
        if not drjit().all(mi.has_flag(film.flags(), mi.FilmFlags.Special)):
            return method(self, scene, sensor, *others, **options)
        with _samples_of(film):
            return method(self, scene, sensor, *others, **options)

    return render


@contextmanager
def _samples_of(film: MitsubaObject) -> Iterator[None]:
    """Convert samples that are put into a block to the channels of this film."""
    mi = mitsuba()
    put = mi.ImageBlock.put

    def put_sample(
        block: MitsubaObject,
        *,
        pos: Array,
        wavelengths: Array,
        value: Array,
        weight: float,
        alpha: float,
        active: Array,
    ) -> None:
        shares = mi.Float(weight), mi.Float(alpha)
        names = dict(zip(("weight", "alpha"), shares, strict=True))
        channels = film.prepare_sample(value, wavelengths, block.channel_count(), **names)
        put(block, pos, channels, active)

    mi.ImageBlock.put = put_sample
    try:
        yield
    finally:
        mi.ImageBlock.put = put

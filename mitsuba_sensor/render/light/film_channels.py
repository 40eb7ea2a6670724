"""The film's channels: bands, and beside them the colour filters of the camera, whose photoelectrons are then exact.

A band holds the light of all its wavelengths together, so the photoelectrons that it frees are known only for an
assumed spectrum. The filters' own responses are therefore integrated too, on the same light paths.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...camera.fingerprint import pixel_fingerprint
from ..samples import hashed_seed
from .bands import Bands, filter_responses

if TYPE_CHECKING:
    from ..load.scene import Scene
    from ..motion.moving_scene import MovingScene


def with_filters(bands: Bands, camera: Camera) -> Bands:
    """The bands, and the responses of the camera's filters in each group of bands that is rendered for itself."""
    if bands.kind == "channels":
        return bands
    curves = [
        r
        for g in bands.groups
        for r in filter_responses(camera, *bands.ends_of(g), bands.reference_nm)
    ]
    count = len(camera.quantum_efficiency.curves)
    return replace(
        bands,
        responses=(*bands.responses, *curves),
        filters=count,
        response=pixel_fingerprint(camera),
    )


def radiance_of(
    scene: Scene | MovingScene,
    bands: Bands,
    groups: tuple[slice, ...],
    seed: int,
    samples: int,
    rows: tuple[int, int],
) -> NDArray[np.float32]:
    """Return a pass of some rows, the groups of bands one after the other, (rows, columns, B + filters)."""
    if len(groups) == 1:
        if bands.kind == "cube":
            scene.restrict_wavelengths(*bands.ends_nm)
        return folded([scene.render(seed, samples, rows)], groups, bands)

    def of_group(number: int) -> NDArray[np.float32]:
        scene.restrict_wavelengths(*bands.ends_of(groups[number]))
        return scene.render(hashed_seed(seed, number, 0), samples, rows)

    return folded((of_group(number) for number in range(len(groups))), groups, bands)


def folded(
    images: Iterable[NDArray[np.float32]], groups: tuple[slice, ...], bands: Bands
) -> NDArray[np.float32]:
    """Renders of groups of bands → (H, W, B + filters). images : (H, W, channels of the film), one for each group."""
    parts, filters = list[NDArray[np.float32]](), np.zeros(1, np.float32)
    count, sets = len(bands), len(bands.groups)
    if sets == 1:
        (image,) = images
        return image
    for number, (group, image) in enumerate(zip(groups, images, strict=True)):
        parts.append(image[..., group])
        of_groups = image[..., count:].reshape(*image.shape[:2], sets, bands.filters)
        filters = filters + np.asarray(
            of_groups.sum(axis=2) if len(groups) < sets else of_groups[:, :, number]
        )
    return np.concatenate([*parts, filters], axis=-1)

"""The network of Open Image Denoise, which filters pictures; no other module knows the library."""

from __future__ import annotations

import importlib
from contextlib import ExitStack
from importlib import metadata
from types import ModuleType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from ..options import RenderOptions

COLOURS = 3  # channels of a picture
MOST_MEMORY_MB = 400
"""Memory of the network, about: it goes through larger pictures in tiles, which takes longer."""
TURNS = (1, 1), (-1, -1), (1, -1), (-1, 1)  # steps along rows and columns


def library() -> ModuleType:
    """The module pyoidn. Raises InputError if it is not installed."""
    try:
        return importlib.import_module("pyoidn")
    except ImportError:
        remedy = "pip install pyoidn, or leave denoise out"
        raise InputError(
            f"denoise needs Open Image Denoise, which this machine has not; {remedy}."
        ) from None


def is_installed() -> bool:
    """Whether Open Image Denoise can be loaded."""
    try:
        library()
    except InputError:
        return False
    return True


def name() -> str:
    """Name of the library, with its version."""
    return f"Open Image Denoise (pyoidn {metadata.version('pyoidn')})"


def denoised_if_possible(options: RenderOptions) -> RenderOptions:
    """The options with ``denoise`` where it is not decided and Open Image Denoise is installed."""
    if options["denoise"] is None and is_installed():
        return {**options, "denoise": True}
    return options


def is_undecided(options: RenderOptions) -> bool:
    """Whether a forecast may leave out denoising: not where both lights or repeatable ones are asked for."""
    decided = options["denoise"] is not None or options["raw_light"] or options["repeatable"]
    return not decided and is_installed()


class Network:
    """Filters pictures (H, W, 3) of one size, as many as there are, within ``with``; large ones in tiles that overlap,
    with the same result. Its memory is given back at the end, which the library's own function does not do.

    normal : (H, W, 3) of the surfaces that all pictures show, or None where they have no guides.
    """

    def __init__(self, shape: tuple[int, int], normal: NDArray[np.float32] | None) -> None:
        names = ["color", "output"]
        if normal is not None:
            names = ["color", "albedo", "normal", "output"]
        self._images = {name: np.zeros((*shape, COLOURS), np.float32) for name in names}
        self._normal = normal

    def __enter__(self) -> Self:
        oidn = library()
        with ExitStack() as stack:
            self._processor = stack.enter_context(oidn.Device())
            self._processor.commit()
            self._filter = stack.enter_context(oidn.Filter(self._processor))
            for name, image in self._images.items():
                self._filter.set_image(name, image, oidn.OIDN_FORMAT_FLOAT3)
            self._filter.set_bool("hdr", True)
            self._filter.set_bool("cleanAux", self._normal is not None)
            self._filter.set_int("maxMemoryMB", MOST_MEMORY_MB)
            self._filter.commit()
            self._open = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()
        self._images = {}

    def filtered(
        self, colours: NDArray[np.float32], albedo: NDArray[np.float32] | float, turn: int
    ) -> NDArray[np.float32]:
        """What the network makes of a picture, (H, W, 3), until the next one.

        albedo : (H, W) of the surfaces; not used without normals.  turn : which of the TURNS the network sees: it errs
        otherwise about a picture that is turned, so that the mean over several has less error.
        """
        rows, columns = TURNS[turn % len(TURNS)]
        self._images["color"][::rows, ::columns] = colours
        if self._normal is not None:
            self._images["albedo"][::rows, ::columns] = np.asarray(albedo)[..., None]
            self._images["normal"][::rows, ::columns] = self._normal
        self._filter.execute()
        problem = self._processor.get_error()
        if problem is not None:
            raise RuntimeError(f"Open Image Denoise: {problem}")
        return self._images["output"][::rows, ::columns]

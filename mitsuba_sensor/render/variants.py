"""Choice of the Mitsuba variant; every ``import mitsuba`` of the package goes through :func:`mitsuba`."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, wraps
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, ParamSpec, TypeAlias, TypeVar

from ..core import InputError, nearest
from ..core.llvm import backend_problem, drjit, llvm_remedy, llvm_version

if TYPE_CHECKING:
    from ..core import Array, Float64Array

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
Item = TypeVar("Item")
MitsubaObject: TypeAlias = (
    Any  # scene, sensor, film, ray, transform, properties …: its class depends on the variant
)

POLARIZED = "_polarized"  # suffix of variants that trace the polarisation of light
VARIANTS = ("cuda_ad_spectral", "llvm_ad_spectral", "scalar_spectral")  # the fastest first
FASTER = "up to about three times faster with LLVM, depending on the processor: "


@dataclass(frozen=True)
class Variant:
    """Chosen Mitsuba variant.  hint : how to make it faster, or an empty string."""

    name: str
    backend: str
    reason: str
    hint: str = ""


def mitsuba() -> ModuleType:
    """Import Mitsuba, and Dr.Jit with its guard before it. Sets no variant."""
    drjit()
    mi = importlib.import_module("mitsuba")
    _look_at_home_first(mi)
    return mi


@cache
def _look_at_home_first(mi: ModuleType) -> None:
    """Make Mitsuba look for plugins in its own folder first; otherwise it would run plugins from the working folder."""
    own_folder_first(mi.file_resolver())


def own_folder_first(resolver: MitsubaObject) -> None:
    """Make a file resolver look into Mitsuba's folder first."""
    resolver.prepend(str(Path(str(importlib.import_module("mitsuba").__file__)).parent))


def choose_variant(requested: str | None = None) -> Variant:
    """Return a spectral variant: the requested one, else the current one if it is spectral, else cuda, llvm or scalar.

    Sets no variant. Raises InputError if a variant is unknown or not spectral, or its backend does not work here.
    """
    current = mitsuba().variant()
    if requested is not None:
        return _checked(requested, "asked for", f"variant is {requested!r}")
    if current in _spectral_variants():
        return _checked(current, "already set", f"the variant already set is {current!r}")
    return fastest_variant("cuda", "llvm")


def fastest_variant(*backends: str) -> Variant:
    """Return the variant of the first backend that works here, else the scalar one; sets no variant."""
    reasons = {"cuda": "a CUDA device is present", "llvm": f"LLVM {llvm_version()} is usable"}
    for backend in backends:
        both = f"{backend}_spectral", f"{backend}_ad_spectral"
        name = next((v for v in both if v in mitsuba().variants()), None)
        if name and backend_problem(backend) is None:
            return Variant(name, backend, reasons[backend])
    return Variant("scalar_spectral", "scalar", backend_problem("llvm") or "", _faster())


def use(variant: Variant) -> ModuleType:
    """Set ``variant`` if it is not the current variant, and return Mitsuba."""
    mi = mitsuba()
    if mi.variant() != variant.name:
        mi.set_variant(variant.name)
    return mi


def parser_config() -> MitsubaObject:
    """Return Mitsuba's settings for building scenes: meshes stay separate, so they can move by name, and plugins are
    built one after the other.

    Built in parallel, plugins get different numbers in about one process in four. Then kernels are compiled again,
    although the cache has them.
    """
    mi = mitsuba()
    config = mi.parser.ParserConfig(mi.variant() or "scalar_spectral")
    config.merge_meshes = config.parallel = False
    return config


@contextmanager
def variant_restored() -> Iterator[None]:
    """Restore the user's variant after the block, also after an error.

    If no variant was set, the variant of the block stays, because Mitsuba cannot unset it.
    """
    mi = sys.modules.get("mitsuba")
    before = mi.variant() if mi is not None else None
    try:
        yield
    finally:
        if before is not None and mitsuba().variant() != before:
            mitsuba().set_variant(before)


def restores_variant(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Return the function, called inside :func:`variant_restored`."""

    @wraps(function)
    def call(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        with variant_restored():
            return function(*arguments, **options)

    return call


def computed_in(variant: Variant, items: Iterator[Item]) -> Iterator[Item]:
    """Yield the items of an iterator that computes in ``variant``; the user's variant is current between items."""
    ended = object()
    while True:
        with variant_restored():
            use(variant)
            item = next(items, ended)
        if item is ended:
            return
        yield item  # type: ignore[misc]


def values_of(thing: MitsubaObject) -> Iterator[tuple[str, MitsubaObject]]:
    """Yield (name, value) of each parameter of a Mitsuba object that is set. Mitsuba's own iterator fails if one is not
    set, e.g. the colour of hair with pigments."""
    parameters = mitsuba().traverse(thing)
    for name, (value, *_) in parameters.properties.items():
        if value is not None:
            yield name, parameters[name]


def evaluate(
    function: Callable[..., tuple[Array, ...]], inputs: Float64Array
) -> list[Float64Array]:
    """Return the outputs, each (N, …), of a function of Mitsuba's numbers for inputs (N, k): all at once, or one by one
    in scalar variants."""
    import numpy as np  # not before the command line shows its help

    if mitsuba().variant().startswith("scalar"):
        # NumPy takes 40 µs for each of Mitsuba's vectors, and hardly any time for a list.
        rows = [
            [list(out) if hasattr(out, "__len__") else out for out in function(*row)]
            for row in inputs.tolist()
        ]
        return [np.array(column, np.float64) for column in zip(*rows, strict=True)]
    # Made from lists the arrays are aligned; NumPy's may not be, and each alignment compiles a kernel (0.7 s).
    outputs = function(*(mitsuba().Float(column.tolist()) for column in inputs.T))
    drjit().eval(outputs)
    arrays = [np.atleast_1d(np.array(out, dtype=np.float64).T) for out in outputs]
    # Constant outputs, e.g. the direction of parallel rays, have one entry only.
    return [np.broadcast_to(x, (len(inputs), *x.shape[1:])) for x in arrays]


def is_polarized() -> bool:
    """Return True if the current variant traces the polarisation of light."""
    return str(mitsuba().variant()).endswith(POLARIZED)


def polarized(variant: Variant) -> Variant:
    """Return the variant with the same backend that traces the polarisation of light."""
    return replace(variant, name=variant.name.removesuffix(POLARIZED) + POLARIZED)


def _spectral_variants() -> list[str]:
    """Return the installed spectral variants, with and without polarisation."""
    endings = ("_spectral", "_spectral" + POLARIZED)
    return [name for name in mitsuba().variants() if name.endswith(endings)]


def _checked(name: str, reason: str, subject: str) -> Variant:
    known = _spectral_variants()
    if name not in known:
        call = "call mitsuba.set_variant('scalar_spectral') or pass variant='scalar_spectral'"
        raise InputError(
            f"{subject}; it must be one of {', '.join(known)} ({call}).{nearest(name, known)}"
        )
    backend = name.split("_")[0]
    problem = backend_problem(backend)
    if problem:
        remedy = f", or {llvm_remedy()}" if backend == "llvm" else ""
        works = fastest_variant("llvm").name
        raise InputError(f"{subject}, but there is {problem}; use {works}{remedy}.")
    return Variant(name, backend, reason, _faster() if backend == "scalar" else "")


def _faster() -> str:
    """Return how to make rendering faster if LLVM is unusable, else an empty string."""
    return FASTER + llvm_remedy() if backend_problem("llvm") else ""

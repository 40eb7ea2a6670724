"""Chooses the Mitsuba variant that renders; every ``import mitsuba`` of the package goes through :func:`mitsuba`."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, wraps
from pathlib import Path
from types import ModuleType
from typing import Any, ParamSpec, TypeAlias, TypeVar

import numpy as np

from ..core import Array, Float64Array, InputError, nearest
from ..core.llvm import backend_problem, drjit, llvm_remedy, llvm_version

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
Item = TypeVar("Item")
MitsubaObject: TypeAlias = (
    Any  # a scene, sensor, film, ray, transform, properties …: its class depends on the variant
)

POLARIZED = "_polarized"  # end of the names of variants that follow the polarisation of light
VARIANTS = ("cuda_ad_spectral", "llvm_ad_spectral", "scalar_spectral")  # the fastest first
FASTER = "up to about three times faster with LLVM, depending on the processor: "


@dataclass(frozen=True)
class Variant:
    """The chosen Mitsuba variant. hint : one line that says what would make it faster, or an empty string."""

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
    """Let Mitsuba find its plugins in its own folder, before the working folder, from which it would run them too."""
    own_folder_first(mi.file_resolver())


def own_folder_first(resolver: MitsubaObject) -> None:
    """Let a file resolver look into the folder of Mitsuba before all others."""
    resolver.prepend(str(Path(str(importlib.import_module("mitsuba").__file__)).parent))


def choose_variant(requested: str | None = None) -> Variant:
    """Choose a spectral variant: the requested one, else the one already set if it is spectral, else cuda, guarded
    llvm, scalar.

    Sets none. Raises InputError for a variant that is unknown, not spectral, or without its back end on this machine.
    """
    current = mitsuba().variant()
    if requested is not None:
        return _checked(requested, "asked for", f"variant is {requested!r}")
    if current in _spectral_variants():
        return _checked(current, "already set", f"the variant already set is {current!r}")
    return fastest_variant("cuda", "llvm")


def fastest_variant(*backends: str) -> Variant:
    """The first of these back ends that works on this machine, else scalar, whatever is set. Sets none."""
    reasons = {"cuda": "a CUDA device is present", "llvm": f"LLVM {llvm_version()} is usable"}
    for backend in backends:
        both = f"{backend}_spectral", f"{backend}_ad_spectral"
        name = next((v for v in both if v in mitsuba().variants()), None)
        if name and backend_problem(backend) is None:
            return Variant(name, backend, reasons[backend])
    return Variant("scalar_spectral", "scalar", backend_problem("llvm") or "", _faster())


def use(variant: Variant) -> ModuleType:
    """Make ``variant`` the current one if it is not, and return Mitsuba."""
    mi = mitsuba()
    if mi.variant() != variant.name:
        mi.set_variant(variant.name)
    return mi


def parser_config() -> MitsubaObject:
    """How Mitsuba builds scenes: meshes keep their names, by which they move, and plugins are built one after another.

    In parallel, their numbers are others in every fourth process or so, and a kernel with other numbers is compiled
    anew although the one of the last process is in the cache.
    """
    mi = mitsuba()
    config = mi.parser.ParserConfig(mi.variant() or "scalar_spectral")
    config.merge_meshes = config.parallel = False
    return config


@contextmanager
def variant_restored() -> Iterator[None]:
    """Behind this block, the variant that the user had set is the current one again, also after an error.

    Where none was set, that of the block stays, because Mitsuba cannot go back to none.
    """
    mi = sys.modules.get("mitsuba")
    before = mi.variant() if mi is not None else None
    try:
        yield
    finally:
        if before is not None and mitsuba().variant() != before:
            mitsuba().set_variant(before)


def restores_variant(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The function inside :func:`variant_restored`."""

    @wraps(function)
    def call(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        with variant_restored():
            return function(*arguments, **options)

    return call


def computed_in(variant: Variant, items: Iterator[Item]) -> Iterator[Item]:
    """The items of an iterator that computes them in a variant; between them the user's variant is the current one."""
    ended = object()
    while True:
        with variant_restored():
            use(variant)
            item = next(items, ended)
        if item is ended:
            return
        yield item  # type: ignore[misc]


def values_of(thing: MitsubaObject) -> Iterator[tuple[str, MitsubaObject]]:
    """(name, value) of the parameters of an object of Mitsuba, but for those that it has not set: the colour of hair,
    where its pigments are, of which Mitsuba's own iterator fails."""
    parameters = mitsuba().traverse(thing)
    for name, (value, *_) in parameters.properties.items():
        if value is not None:
            yield name, parameters[name]


def evaluate(
    function: Callable[..., tuple[Array, ...]], inputs: Float64Array
) -> list[Float64Array]:
    """Return the outputs, each (N, …), of a function of Mitsuba's numbers for inputs (N, k): all at once, or one by one
    in scalar variants."""
    if mitsuba().variant().startswith("scalar"):
        rows = [
            [np.array(out, np.float64) for out in function(*row)] for row in inputs.tolist()
        ]
        return [np.array(column) for column in zip(*rows, strict=True)]
    # Made from lists the arrays are aligned; NumPy's may not be, and each alignment compiles a kernel (0.7 s).
    outputs = function(*(mitsuba().Float(column.tolist()) for column in inputs.T))
    drjit().eval(outputs)
    arrays = [np.atleast_1d(np.array(out, dtype=np.float64).T) for out in outputs]
    # Constant outputs, e.g. the direction of parallel rays, have one entry only.
    return [np.broadcast_to(x, (len(inputs), *x.shape[1:])) for x in arrays]


def is_polarized() -> bool:
    """Whether the variant that is set follows the polarisation of light."""
    return str(mitsuba().variant()).endswith(POLARIZED)


def polarized(variant: Variant) -> Variant:
    """The variant with the same back end that follows the polarisation of light."""
    return replace(variant, name=variant.name.removesuffix(POLARIZED) + POLARIZED)


def _spectral_variants() -> list[str]:
    """Variants that render here: with spectra, with and without polarisation."""
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
        way_out = "take scalar_spectral" + (
            f", or {llvm_remedy()}" if backend == "llvm" else ""
        )
        raise InputError(f"{subject}, but there is {problem}; {way_out}.")
    return Variant(name, backend, reason, _faster() if backend == "scalar" else "")


def _faster() -> str:
    """What would make scalar variants faster where LLVM cannot be used; else an empty string."""
    return FASTER + llvm_remedy() if backend_problem("llvm") else ""

"""HDF5: SPLIT.h5 with a group for each sample, its arrays with units, and the spectral irradiance of its light."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ...files.hdf5 import new_hdf5
from ...output.exr import read_irradiance_exr
from ..read import FACTS, IMAGES, Sample
from .export import Job

HOW = """import h5py

with h5py.File("{file}") as file:
    for key, sample in file["samples"].items():
        print(key, dict(sample.attrs), [*sample])  # sample["raw"][()] is an array
"""
UNITS = {
    "raw": "DN",
    "companded": "DN",
    "clean": "DN",
    "variance": "DN^2",
    "electrons": "e-",
    "electrons_error": "e-",
    "depth_m": "m",
    "position_m": "m",
    "flow_px": "px",
}
"""Array → its unit; other arrays have no unit."""


def write(job: Job) -> str:
    """Write a file for each split, with samples/KEY and lights/TASK. Returns code that reads them."""
    for split, samples in job.splits().items():
        place = job.place(f"{split or 'all'}.h5")
        with new_hdf5(place) as file:
            about = {"title": job.title, "licence": job.licence, "split": split}
            file.create_group("samples", track_order=True).attrs.update(about)
            for sample in samples:
                _add(job, file, sample)
                job.done()
    return HOW.format(file=place.name)


def _add(job: Job, file: Any, sample: Sample) -> None:
    """Add a sample. The samples of a task share the group of their light, by a link."""
    group, image = (
        file.create_group(f"samples/{sample.key}", track_order=True),
        sample.facts["image"],
    )
    levels = {name: image[name] for name in ("exposure_s", "black_level_dn", "white_level_dn")}
    levels["system_gain_dn_per_e"] = sample.facts["system_gain_dn_per_e"]
    group.attrs.update(_flat({"split": sample.split, **sample.values, **levels}))
    has_light = not job.options["arrays"] and sample.has("irradiance.exr")
    for name in job.arrays_of(sample, IMAGES):
        array = group.create_dataset(name, data=sample.read(name))
        array.attrs["units"] = UNITS.get(name, "1")
    if has_light:
        place = f"lights/{sample.task}"
        if place not in file:
            _add_light(file.create_group(place), sample)
        group["light"] = file[place]
    group.create_dataset("sample_json", data=sample.content(FACTS).decode())


def _add_light(group: Any, sample: Sample) -> None:
    """Add the spectral irradiance of a light, and its wavelengths."""
    with sample.opened("irradiance.exr") as path:
        light = read_irradiance_exr(path)
    unit = "W m-2" if light.filters else "W m-2 nm-1"
    group.attrs.update(_flat({"filters": light.filters}))
    arrays = {
        "irradiance": (light.data, unit),
        "standard_error": (light.standard_error, unit),
        "wavelengths_nm": (light.wavelengths_nm, "nm"),
        "bandwidths_nm": (light.bandwidths_nm, "nm"),
    }
    for name, (array, units) in arrays.items():
        group.create_dataset(name, data=array).attrs["units"] = units


def _flat(values: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Yield attributes; attributes of a table have dotted names, and None has no attribute."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        elif value is not None:
            yield f"{prefix}{name}", value

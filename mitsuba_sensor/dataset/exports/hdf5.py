"""HDF5: SPLIT.h5 with a group for each sample, its arrays with units, and the spectral irradiance of its view."""

from __future__ import annotations

from ...files.hdf5 import Hdf5Writer, hdf5_writer
from ...files.whole_folder import inside
from ...output.exr import read_irradiance_exr
from ..read.reader import IMAGES, Sample
from ..store.entry_files import checked, require_file
from .job import IRRADIANCE, Job, checked_array, facts_of, facts_text_of

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
"""Array → its unit; others are numbers without one."""
LEVELS = ("black_level_dn", "white_level_dn", "exposure_s")
"""Of sample.json, that are attributes beside the values of the sample."""


def write_hdf5(job: Job) -> str:
    """Write a file for each split, with samples/KEY and views/KEY. Returns how to read."""
    name = ""
    for split in sorted({sample.split for sample in job.samples}):
        name = f"{split or 'all'}.h5"
        with hdf5_writer(inside(job.folder, name)) as file:
            about = {"title": job.title, "licence": job.licence, "split": split}
            file.add_group("samples", about)
            views = set[str]()
            for sample in job.samples:
                if sample.split == split:
                    _add(job, file, sample, views)
                    job.step()
    return HOW.format(file=name)


def _add(job: Job, file: Hdf5Writer, sample: Sample, views: set[str]) -> None:
    """A sample, and its view if that is not among ``views`` yet."""
    facts, place = facts_of(sample), f"samples/{sample.key}"
    about = {name: facts["image"][name] for name in LEVELS}
    gain = {"system_gain_dn_per_e": facts["system_gain_dn_per_e"]}
    file.add_group(place, {"split": sample.split, **sample.values, **about, **gain})
    for name in job.arrays_of(sample, (*IMAGES, IRRADIANCE)):
        if name != IRRADIANCE:
            unit = UNITS.get(name, "1")
            file.add_array(f"{place}/{name}", checked_array(sample, name), unit)
            continue
        view = f"views/{facts['view']['key']}"
        if view not in views:
            views.add(view)
            add_light(file, view, sample)
        file.add_link(f"{place}/light", view)
    file.add_text(f"{place}/sample_json", facts_text_of(sample))


def add_light(file: Hdf5Writer, place: str, sample: Sample) -> None:
    """The spectral irradiance of a view, and its wavelengths."""
    file_name = f"{IRRADIANCE}.exr"
    require_file(sample.view_files, file_name, IRRADIANCE)
    checked(sample.view_files, file_name)
    with sample.view_files.opened(file_name) as path:
        light = read_irradiance_exr(path)
    unit = "W m-2 nm-1"
    if light.filters:
        unit = "W m-2"
    file.add_group(place, {"filters": light.filters})
    file.add_array(f"{place}/{IRRADIANCE}", light.data, unit)
    file.add_array(f"{place}/standard_error", light.standard_error, unit)
    file.add_array(f"{place}/wavelengths_nm", light.wavelengths_nm, "nm")
    file.add_array(f"{place}/bandwidths_nm", light.bandwidths_nm, "nm")

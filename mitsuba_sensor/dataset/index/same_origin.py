"""All samples of a dataset folder are made from the same scenes and cameras, by the same versions."""

from __future__ import annotations

import hashlib
from pathlib import Path

from ...core import InputError
from ...files.scene_references import folder_names
from ..plan.file import read_dataset
from ..plan.planned import DatasetPlan, load_plan
from ..plan.sources import changed_sources, uses_of
from ..store.keys import Config, made_by
from ..store.record import FILE, RECORD
from ..store.store import Store
from .index import Index
from .origin import Origin, origin_in, origin_of, require_origin
from .part import all_parts, parts_of

MOST_NAMED = 3
"""Files in a sentence."""


def check_same(plan: DatasetPlan, store: Store) -> None:
    """Raise InputError where the folder holds another dataset, or samples of another origin.

    Its file may say more than before, or less.
    """
    folder, origin = store.folder, origin_in(store.folder)
    if origin is None and (parts := all_parts(folder)):
        if not parts_of(origin_of(plan).digest, parts):
            raise InputError(
                f"{folder / RECORD}, which says what {folder} was made from, is missing or was changed, and the "
                "index is of other samples than this file has; give the file that it was made from, or a new folder."
            )
    elif (name := _name_in(folder, origin)) not in ("", plan.file.name):
        this = plan.file.name
        raise InputError(
            f"{folder} holds the dataset {name!r}, and this one is {this!r}; give another folder."
        )
    if origin is not None:
        require_same_versions(origin.made_by, folder)
        _require_same_form(plan, origin, folder)
        _require_same_sources(plan, origin, store)


def _name_in(folder: Path, origin: Origin | None) -> str:
    """The name of the dataset in a folder, empty for a new one. Raises InputError where there is something else."""
    if origin is not None:
        return origin.name
    if (folder / FILE).exists():
        return read_dataset(folder / FILE).name
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(f"{folder} holds other files and no dataset; give a new folder.")
    return ""


def require_same_versions(then: Config, folder: Path) -> None:
    """Raise InputError where a folder was made by other versions of what pixels depend on."""
    now = made_by()
    if other := [name for name in now if then.get(name) != now[name]]:
        there = ", ".join(f"{name} {then.get(name)}" for name in other)
        here = ", ".join(f"{name} {now[name]}" for name in other)
        raise InputError(
            f"{folder} was made by {there}, and this is {here}, whose pixels may differ; install what made it, or "
            "give a new folder."
        )


def plan_of(folder: Path, roots: list[str] | None) -> DatasetPlan:
    """The plan that a dataset folder was made from, by the versions that made it.

    roots : folders below which the user lets its files be read; by default the current one, as of a run.
    Raises InputError where anything that it was made from is not the same any more.
    """
    origin = require_origin(folder)
    plan = load_plan(folder / FILE, roots or ["."])
    plan = DatasetPlan(plan.file, plan.roots, plan.text, origin.made_by)
    if origin_of(plan, origin.file)._replace(sources=origin.sources) != origin:
        raise InputError(_mixed(plan, origin, folder))
    return plan


def _require_same_form(plan: DatasetPlan, origin: Origin, folder: Path) -> None:
    """Raise InputError where the samples of a run would be kept otherwise than those that are there."""
    before = origin.shard_samples
    if before != plan.shard_samples:
        raise InputError(
            f"{folder} keeps samples with shard_samples = {before}, and this file asks for {plan.shard_samples}, for "
            f"{plan.samples} samples; write `store = {{ shard_samples = {before} }}` at the top of the file, or give a "
            "new folder."
        )


def _require_same_sources(plan: DatasetPlan, origin: Origin, store: Store) -> None:
    """Raise InputError where samples of a run would be made from other files than samples that are there.

    A file of which nothing has been made yet may be another one: a scene that could not be rendered is mended.
    """
    if origin.plan == plan.digest:
        return
    changed = changed_sources(origin.sources, plan.sources)
    same_text = hashlib.sha256(plan.text.encode()).hexdigest() == origin.file[1]
    if (changed and _is_used(changed, plan, origin, store)) or (same_text and not changed):
        raise InputError(_mixed(plan, origin, store.folder))


def _is_used(changed: list[str], plan: DatasetPlan, origin: Origin, store: Store) -> bool:
    """Whether there are samples that were made from these files, by the index, where that has all."""
    parts = parts_of(origin.digest, all_parts(store.folder))
    if len(parts) < origin.parts:
        return bool(store.shards.all()) or next(store.names("samples"), None) is not None
    index = Index(store.folder, parts.values())
    there = {f"{kind} {name}" for kind in ("scene", "camera") for name in index.counts(kind)}
    return not there.isdisjoint(uses_of(plan, changed))


def _mixed(plan: DatasetPlan, origin: Origin, folder: Path) -> str:
    """Why a plan makes other samples than those in a folder, and the way out."""
    changed = changed_sources(origin.sources, plan.sources)
    named = [f"{name} ({origin.sources[name].use}) was changed" for name in changed]
    named += [f"{name} is new" for name in plan.sources if name not in origin.sources]
    named += [
        f"{name} is not read any more" for name in origin.sources if name not in plan.sources
    ]
    said = ", ".join(named[:MOST_NAMED]) or "a lens or the package was changed"
    if len(named) > MOST_NAMED:
        said += f", and {len(named) - MOST_NAMED} more"
    return (
        f"{folder} was made from other files than there are now below {folder_names(plan.roots)}: {said}. Samples "
        "of both would be mixed; restore the files and give the same --root as its run did, or make a dataset of the "
        "changed ones in a new folder: `mitsuba-sensor dataset run FILE.toml -o NEW`."
    )

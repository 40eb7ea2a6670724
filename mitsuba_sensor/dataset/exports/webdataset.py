"""WebDataset shards by split: SPLIT-000000.tar with KEY.json, KEY.png and KEY.NAME.npy for each requested array.

The shards of a dataset also have WebDataset's layout; the arrays of these shards need no reader of TIFFs.
"""

from __future__ import annotations

import io

import numpy as np

from ..read import FACTS, Sample
from ..store import member_bytes
from ..values import PICTURE
from .export import Job

HOW = """import webdataset as wds

samples = wds.WebDataset("{shards}", shardshuffle=False).decode()
for sample in samples:
    print(sample["__key__"], {names}, sample["json"]["values"])
"""
TAR_END = bytes(1024)


def write(job: Job) -> str:
    """Write the shards of every split, sorted by key: a random but fixed order. Returns code that reads them."""
    for split, samples in job.splits().items():
        name, number, content = split or "shard", 0, list[bytes]()
        for line in sorted(samples.table, key=lambda line: line.key):
            sample = Sample(samples.store, line)
            arrays = {f"{x}.npy": npy(sample.read(x)) for x in job.arrays_of(sample)}
            files = {**arrays, "json": sample.content(FACTS)}
            if sample.has(PICTURE):
                files["png"] = sample.content(PICTURE)
            members = b"".join(member_bytes(f"{sample.key}.{x}", y) for x, y in files.items())
            shard_bytes = job.shard_bytes - len(TAR_END)
            if content and sum(map(len, content)) + len(members) > shard_bytes:
                job.bytes(f"{name}-{number:06d}.tar", b"".join([*content, TAR_END]))
                number, content = number + 1, []
            content.append(members)
            job.done()
        job.bytes(f"{name}-{number:06d}.tar", b"".join([*content, TAR_END]))
    names = ", ".join(f'sample["{x}"].shape' for x in arrays)
    return HOW.format(shards=f"{name}-{{000000..{number:06d}}}.tar", names=names)


def npy(array: np.ndarray) -> bytes:
    """Return the bytes of a .npy file."""
    content = io.BytesIO()
    np.save(content, array, allow_pickle=False)
    return content.getvalue()

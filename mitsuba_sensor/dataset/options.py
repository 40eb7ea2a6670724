"""The options of a run: which part of a dataset is made, by how many processes, within which limits."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
from typing import Annotated, TypedDict

from ..core import InputError
from ..core.options import Option

ENGINE = "Engine"
SHARDS_MAX = 10**6


def checked_shard(name: str, value: object) -> tuple[int, int]:
    """Return (i, n) from the text "i/n" or a pair. Raises InputError."""
    parts = [*map(str, value)] if isinstance(value, tuple) else str(value).split("/")
    if len(parts) == 2 and all(map(str.isdecimal, parts)):
        part, parts_in_all = map(int, parts)
        if 1 <= part <= parts_in_all <= SHARDS_MAX:
            return part, parts_in_all
    raise InputError(f"{name} is {value!r}; give i/n with i from 1 to n, e.g. 1/4.")


class RootOptions(TypedDict, total=False):
    """Which files a dataset may read."""

    roots: Annotated[
        list[str] | None,
        Option(
            "Folder with scenes, cameras and motions, searched after the folder of the dataset file. Repeatable. "
            "Default: the current folder.",
            flag="--root",
            metavar="DIR",
            panel="Scene",
            text=list[str],
        ),
    ]
    untrusted: Annotated[
        bool,
        Option(
            "Read only files in these folders and in the folder of the dataset file, whatever the file and its scenes "
            "name: for datasets that somebody else wrote.",
            False,
            panel="Scene",
        ),
    ]


class RunOptions(TypedDict, total=False):
    """All options of :func:`dataset.run`."""

    workers: Annotated[
        int | None,
        Option(
            "Processes on this machine. 0 uses only this process, which then ends if a scene crashes the renderer. "
            "Default: 2 if there are two cores.",
            low=0,
            high=1024,
            example="2",
            panel=ENGINE,
        ),
    ]
    scheduler: Annotated[
        str | None,
        Option(
            "Use the workers of this Dask scheduler instead; all must see DIR and the scenes.",
            metavar="tcp://HOST:PORT",
            panel=ENGINE,
        ),
    ]
    tls_ca: Annotated[
        str | None,
        Option(
            "Certificate authority of a scheduler at tls://HOST:PORT.",
            metavar="FILE",
            panel=ENGINE,
        ),
    ]
    tls_cert: Annotated[
        str | None, Option("Certificate for this scheduler.", metavar="FILE", panel=ENGINE)
    ]
    tls_key: Annotated[
        str | None, Option("Private key of the certificate.", metavar="FILE", panel=ENGINE)
    ]
    shard: Annotated[
        tuple[int, int] | None,
        Option(
            "Make only the i-th of n equal parts, so n machines need no scheduler.",
            check=checked_shard,
            metavar="i/n",
            panel=ENGINE,
            text=str,
        ),
    ]
    timeout_s: Annotated[
        float | None,
        Option(
            "End a process that takes longer for a render and its samples [s]. Default: never.",
            low=0.001,
            high=1e9,
            example="600",
            panel=ENGINE,
        ),
    ]
    memory_gb: Annotated[
        float | None,
        Option(
            "End a process that needs more memory [GB]; 0.3 GB are in use before the first render. Default: no limit.",
            low=0.5,
            high=1e6,
            example="4",
            panel=ENGINE,
        ),
    ]
    retry: Annotated[bool, Option("Try failed renders again.", False, panel=ENGINE)]

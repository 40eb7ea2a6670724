"""The table of export formats, and the options of an export; a format is a row here and a module of its name."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
from typing import Annotated, Literal, NamedTuple, TypedDict

from ...core.options import Option

PANEL = "Export"


class Format(NamedTuple):
    """One format; ``write(job)`` of the module with its name writes it and returns code that reads it.

    contents : what is written.  needs : library that the package does not install.  takes : its options among those
    that not every format takes.  images : default pictures.  shard_mb : default size limit of a file [MB].
    """

    name: str
    contents: str
    needs: str = ""
    takes: tuple[str, ...] = ()
    images: str | None = None
    shard_mb: int | None = None


ARRAYS, SHARDS, IMAGES = ("arrays",), ("arrays", "shard_mb"), ("images",)
FORMATS = (
    Format("parquet", "a data set of Hugging Face with images", "", SHARDS, None, 256),
    Format("webdataset", "tar shards of arrays by split", "", SHARDS, None, 256),
    Format("hdf5", "arrays and spectra with units", "h5py", ARRAYS),
    Format("coco", "pictures and instance masks", "pycocotools", IMAGES, "preview"),
    Format("nerfstudio", "pictures, poses and depth", "", IMAGES, "preview"),
    Format("colmap", "pictures and poses as a text model", "", IMAGES, "preview"),
    Format("kitti", "sequences with times, poses and calibrations", "", IMAGES, "raw"),
    Format(
        "euroc", "the same contents as mav0 folders, and Kalibr's camchain", "", IMAGES, "raw"
    ),
    Format("opencv", "calibrations and poses as FileStorage"),
    Format("ros", "calibrations as camera_info"),
    Format("files", "the files of each sample in a folder"),
    Format("card", "README.md with a contact sheet alone"),
)


class ExportOptions(TypedDict, total=False):
    """All options of :func:`export`."""

    split: Annotated[
        str | None, Option("Only samples of this split.", metavar="NAME", panel=PANEL)
    ]
    arrays: Annotated[
        list[str] | None,
        Option(
            "An array of each sample in parquet, webdataset and hdf5: raw, clean, variance, electrons, depth, … "
            "Repeatable. Default: raw, clean and variance; in hdf5 all images.",
            flag="--array",
            metavar="NAME",
            panel=PANEL,
            text=list[str],
        ),
    ]
    shard_mb: Annotated[
        int | None,
        Option(
            "Size limit of a file in parquet and webdataset [MB]. Default: 256.",
            low=1,
            high=10**6,
            example="500",
            panel=PANEL,
        ),
    ]
    images: Annotated[
        Literal["preview", "raw"] | None,
        Option(
            "Pictures in coco, nerfstudio, colmap, kitti and euroc: the preview, or the digital numbers of the first "
            "raw frame. Default: raw in kitti and euroc, else preview.",
            panel=PANEL,
        ),
    ]
    incomplete: Annotated[
        bool,
        Option(
            "Export an incomplete dataset, which is otherwise rejected.",
            False,
            panel=PANEL,
        ),
    ]
    licence: Annotated[
        str | None,
        Option(
            "Licence for the card. Default: the licence in the dataset file.",
            metavar="TEXT",
            panel=PANEL,
        ),
    ]
    force: Annotated[
        bool, Option("Replace an existing export.", False, flag="--force", panel=PANEL)
    ]

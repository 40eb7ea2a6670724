"""Reading a dataset: samples by number, key and value, arrays, batches, card, contact sheet, table, `show`."""

from __future__ import annotations

import base64
import csv
import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.dataset import TorchDataset, batches, make_dataset
from mitsuba_sensor.dataset.card import (
    SAMPLES_READ_MAX,
    caption,
    columns_of,
    less_render_noise,
    sheet_rows,
)
from mitsuba_sensor.dataset.store import Row, Store
from mitsuba_sensor.optics.spectra import inverse_srgb_curve, srgb_curve
from mitsuba_sensor.output.contact_sheet import brightened, text_picture

FILE = """
name = "views"
description = "two scenes | small"
licence = "CC0-1.0"
outputs = ["raw", "clean", "variance", "preview", "aovs"]
render = { spp = 4, width = 24, denoise = false }
cameras = [{ camera = "konnik_table1", set = { "adc.full_scale_v" = 1.0 } }]
grid = { exposure_ev = [0, -2] }
list = [
    { exposure_s = 2.2e-5, "camera.adc.full_scale_v" = 1.0 },
    { exposure_s = "auto", "camera.adc.full_scale_v" = 0.1 },
]
[[scenes]]
name = "flat"
file = "flat_field"
[[scenes]]
name = "box"
file = "cornell_box"
views = [{ origin_m = [0, 1, 3.9], target_m = [0, 1, 0] }, { origin_m = [0, 1.5, 3.9], target_m = [0, 1, 0] }]
[splits]
shares = { train = 0.5, test = 0.5 }
"""


def test_letters_that_the_font_of_a_contact_sheet_lacks_are_replaced() -> None:
    """The font that comes with Pillow has only ASCII."""
    for given, drawn in {"912 µs": "912 us", "Ä": "?"}.items():
        assert text_picture([given]).tobytes() == text_picture([drawn]).tobytes()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("views")
    (folder / "views.toml").write_text(FILE, "utf-8")
    found = make_dataset(folder / "views.toml", folder / "out", workers=0)
    assert not found.failed and found.render_noise.startswith("Render noise is ")
    return folder / "out"


def test_a_sample_shows_itself_and_its_arrays(made: Path) -> None:
    dataset = ms.Dataset(made)
    assert repr(dataset).startswith("<Dataset: 12 samples (test ") and len(dataset[2:5]) == 3
    for sample in dataset:
        assert len(repr(sample)) < 250 and sample.key[:8] in repr(sample)
        depth_m = sample.read("depth")
        np.testing.assert_array_equal(depth_m, sample.read("depth_m"))
        assert sample.read("raw").shape == (1, *depth_m.shape)
        assert sample.read("clean").dtype == np.float32
        assert json.loads(sample.files["sample.json"]) == sample.facts
    for name, said in (
        ("aovs", "it can have raw, .* depth, "),
        ("raww", "Did you mean 'raw'"),
        ("companded", "outputs"),
    ):
        with pytest.raises(ms.InputError, match=said):
            sample.read(name)
    with pytest.raises(ms.InputError, match="there is no dataset in"):
        ms.Dataset(made.parent)


def test_samples_are_found_by_scene_view_and_exposure(made: Path) -> None:
    samples = ms.Dataset(made)
    found = samples.where(scene="box", view=1, exposure_s=2.2e-5)
    assert isinstance(found, ms.Dataset)
    assert [one.values["exposure_ev"] for one in found] == [0, -2]
    assert [x.key for x in samples.where(exposure_s="auto", exposure_ev=-2.0, view=0)] == [
        samples[7].key
    ]
    assert len(samples.where(exposure_s=2.2e-5 * (1 + 1e-15))) == 6
    assert len(found.where(exposure_ev=0)) == 1 and not len(samples.where(scene="flat", view=0))
    metered_s = samples[7].facts["image"]["exposure_s"]
    assert samples[7].key in [x.key for x in samples.where(exposed_s=metered_s)]


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"scene": "boxx"}, "scene is 'boxx'; the samples have flat, box. Did you mean 'box'?"),
        ({"scene": "box", "view": 7}, "view is 7; the samples have 0, 1."),
        ({"exposure_ev": "-7"}, "exposure_ev is '-7'; the samples have 0, -2.\n"),
        ({"split": "val"}, "split is 'val'; the samples have"),
        ({"exposure": 1}, "no sample has 'exposure'; samples have split, "),
    ],
)
def test_what_no_sample_has_is_a_sentence_with_what_there_is(
    made: Path, asked: dict[str, object], sentence: str
) -> None:
    with pytest.raises(ms.InputError) as caught:
        ms.Dataset(made).where(**asked)
    assert f"{caught.value}\n".startswith(sentence)


def test_show_says_what_a_sample_is(
    made: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """Times and temperatures keep their digits; samples are found by number and by the beginning of a key."""
    sample = ms.Dataset(made)[4]
    facts = json.loads(cli("dataset", "show", made, "4", "--json").stdout)
    by_key = json.loads(cli("dataset", "show", made, sample.key[:8].upper(), "--json").stdout)
    assert facts == by_key and facts["key"] == sample.key
    noise_dn = float(np.median(np.sqrt(sample.read("variance"))))
    signal_dn = np.median(sample.read("raw")) - facts["image"]["black_level_dn"]
    assert facts["noise"]["snr"] == pytest.approx(signal_dn / noise_dn)
    assert facts["files"]["frame.png"] == len(sample.files["frame.png"])
    said = " ".join(cli("dataset", "show", made, "4").stdout.split())
    assert "exposure_s 2.2e-05" in said and "temperature_k 298.15" in said
    for wrong in ("12", "-1", "abc", "f" * 24, ""):
        done = cli("dataset", "show", made, "--", wrong)
        assert done.exit_code == 2 and "give a number from 0 to 11, or a key" in done.stderr
    place = tmp_path / "four.png"
    assert cli("dataset", "show", made, "4", "--picture", place).exit_code == 0
    np.testing.assert_array_equal(np.asarray(Image.open(place)), sample.read("preview"))


def test_a_preview_that_is_not_stored_is_developed(made: Path, tmp_path: Path) -> None:
    """Images are equal for a camera without colour filters, whose white does not depend on the light."""
    file = tmp_path / "views.toml"
    text = FILE[: FILE.index('[[scenes]]\nname = "box"')].replace(', "preview", "aovs"', "")
    file.write_text(text, "utf-8")
    make_dataset(file, tmp_path / "out", workers=0)
    flat = ms.Dataset(made).where(scene="flat")
    for stored, developed in zip(flat, ms.Dataset(tmp_path / "out"), strict=True):
        assert not developed.has("frame.png")
        with pytest.raises(ms.InputError, match="no aovs, so it has no depth; add 'aovs' to"):
            developed.read("depth")
        np.testing.assert_array_equal(stored.read("preview"), developed.read("preview"))
    assert (tmp_path / "out/contact_sheet.png").is_file()


def test_batches_are_every_sample_once_in_an_order_of_each_epoch(made: Path) -> None:
    samples, orders = ms.Dataset(made, "train"), []
    means = sorted(float(one.read("clean").mean()) for one in samples)
    for epoch in (0, 1, 0):
        found = list(batches(samples, ("raw", "clean"), 3, seed=3, epoch=epoch))
        assert {len(one["raw"]) for one in found[:-1]} <= {3}
        orders.append([float(x.mean()) for one in found for x in one["clean"]])
        assert sorted(orders[-1]) == means
    assert orders[0] == orders[2] != orders[1]


class _Arrays:
    def __init__(self, *shape: int) -> None:
        self.read = lambda name: np.zeros(shape)


@pytest.mark.parametrize(
    ("name", "shapes", "message"),
    [
        ("raw", ((1, 18, 24), (1, 24, 24)), r"18 × 24 and 24 × 24 pixels; use one scene"),
        ("preview", ((18, 24, 3), (24, 24, 3)), r"18 × 24 and 24 × 24 pixels; use one scene"),
        ("raw", ((1, 4, 4), (2, 4, 4)), r"raw of shape \(1, 4, 4\) and \(2, 4, 4\); use one"),
    ],
)
def test_a_batch_of_different_shapes_is_rejected(
    name: str, shapes: tuple[tuple[int, ...], ...], message: str
) -> None:
    samples = [_Arrays(*shape) for shape in shapes]
    assert len(list(batches(samples, (name,), np.uint8(1)))) == 2
    with pytest.raises(ms.InputError, match=message):
        next(batches(samples, (name,)))


@pytest.mark.parametrize(
    "given",
    [
        *({"size": size} for size in (0, 2.5, True)),
        *({"names": names} for names in ("raw", (1,), ())),
        {"seed": -1},
        {"epoch": 0.5},
    ],
)
def test_wrong_arguments_of_batches_are_rejected_at_once(given: dict[str, Any]) -> None:
    with pytest.raises(ms.InputError, match=f"{next(iter(given))} is "):
        batches([], **given)


def test_pytorch_is_missed_when_a_torch_dataset_is_made(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mitsuba_sensor.dataset.training.find_spec", lambda name: None)
    with pytest.raises(ms.InputError, match="pip install torch"):
        TorchDataset(ms.Dataset(made))


def test_pytorch_loads_samples_in_workers(made: Path) -> None:
    samples = ms.Dataset(made, "test")
    again = pickle.loads(pickle.dumps(samples))
    assert [x.key for x in again] == [x.key for x in samples]
    torch = pytest.importorskip("torch")
    data = TorchDataset(samples, ("raw", "shape_index"), transform=lambda found: found[:1])
    loader = torch.utils.data.DataLoader(data, batch_size=4, num_workers=2)
    raw = torch.cat([raw for (raw,) in loader])
    expected = np.stack([one.read("raw") for one in samples]).astype(np.float32)
    np.testing.assert_array_equal(raw.numpy(), expected)
    assert TorchDataset(samples, ("shape_index",))[0][0].dtype == torch.int64


def test_card_and_table_say_what_is_in_the_dataset(made: Path) -> None:
    """A gain that an axis varies tenfold is a range; every sample has a row with its own gain."""
    samples, text = [*ms.Dataset(made)], (made / "README.md").read_text("utf-8")
    rows = [[cell.strip() for cell in x.split("|")[1:-1]] for x in text.splitlines()]
    counts = {row[0]: row[1] for row in rows if len(row) == 2}
    assert "license: cc0-1.0" in text and "two scenes | small" in text
    assert (counts["samples"], counts["renders"], counts["scenes"]) == ("12", "3", "box, flat")
    total = sum(len(x) for sample in samples for x in sample.files.values())
    assert int(counts["bytes"].replace(" ", "")) > total
    frames = [sample.read("raw") for sample in samples]
    (row,) = (row for row in rows if "raw frame [DN]" in row)
    ends = [int(cell.replace(" ", "")) for cell in (row[3], row[-1])]
    assert ends == [np.min(frames), np.max(frames)]
    ratios = {one.task: one.facts["light"]["noise_ratio_median"] for one in samples}
    assert f"Render noise is {np.median([*ratios.values()]):.3g} × " in text
    gains = sorted({one.facts["system_gain_dn_per_e"] for one in samples})
    assert f"| {gains[0]:.5g} to {gains[-1]:.5g} |" in text
    with (made / "samples.csv").open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    for sample, line in zip(samples, lines, strict=True):
        assert (line["key"], line["scene"]) == (sample.key, sample.values["scene"])
        assert float(line["exposed_s"]) == sample.facts["image"]["exposure_s"]
        assert float(line["system_gain_dn_per_e"]) == sample.facts["system_gain_dn_per_e"]
    assert lines[-1]["pose.origin_m"] == "0.0 1.5 3.9" and lines[0]["pose.origin_m"] == ""


def test_a_run_that_changes_nothing_leaves_them_and_writes_again_what_is_missing(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("README.md", "contact_sheet.png", "samples.csv")
    before = {name: (made / name).read_bytes() for name in names}
    for name in names:
        (made / name).unlink()
        make_dataset(made.parent / "views.toml", made, workers=0)
        assert {x: (made / x).read_bytes() for x in names} == before
    monkeypatch.setattr("mitsuba_sensor.dataset.card.write_card", None)
    assert not make_dataset(made.parent / "views.toml", made, workers=0).remarks
    (made / "README.md").rename(made / "kept")
    (made / "README.md").mkdir()
    monkeypatch.undo()
    (remark,) = make_dataset(made.parent / "views.toml", made, workers=0).remarks
    assert "was not written: cannot write" in remark
    (made / "README.md").rmdir()
    (made / "kept").rename(made / "README.md")


def test_a_card_reads_some_samples_of_a_big_dataset(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Callable[..., Any]
) -> None:
    assert SAMPLES_READ_MAX >= 100
    monkeypatch.setattr("mitsuba_sensor.dataset.card.SAMPLES_READ_MAX", 3)
    done = cli("dataset", "export", "card", made, "-o", tmp_path / "out", "--licence", "a b")
    text = (tmp_path / "out/README.md").read_text("utf-8")
    assert done.exit_code == 0 and "| samples | 12 |" in text and "license:" not in text
    assert "\n3 of the 12 samples, evenly chosen, were read" in text and "\na b\n" in text


def test_a_sheet_shows_scenes_views_and_exposures(made: Path) -> None:
    rows = sheet_rows(Store(made), ms.Dataset(made).table)
    captions = [picture.caption for row in rows for picture in row.pictures]
    assert [len(row.pictures) for row in rows] == [4, 4, 4], "each row is a scene and view"
    assert [lines[0] for lines in captions[::4]] == [
        "0: flat",
        "4: box, view 0",
        "8: box, view 1",
    ]
    assert {"22 µs", "5.5 µs, -2 EV"} < {lines[1] for lines in captions}
    assert {lines[2] for lines in captions} == {"full_scale_v 1", "full_scale_v 0.1"}


@pytest.mark.parametrize(
    "sizes", [[40], [64], [7], [10] * 3, [8] * 8, [1] * 12, [40, 1], [2, 3], [7, 7]]
)
def test_a_sheet_is_nearly_square(sizes: list[int]) -> None:
    columns = columns_of(sizes, 1.2)
    assert 0.4 < 1.2 * columns / -(-sum(sizes) // columns) < 2.5


@pytest.mark.parametrize(
    ("render", "advised", "not_advised"),
    [
        ({}, ("denoise", "larger `spp`", "noise_ratio = 0.1"), ("max_spp` or",)),
        ({"denoise": True, "spp": 64}, ("without `spp`",), ("denoise",)),
        ({"noise_ratio": 0.5}, ("larger `max_spp`", "smaller `noise_ratio`"), ("= 0.1",)),
        ({"noise_ratio": 0.05, "max_spp": 8}, ("larger `max_spp`",), ("noise_ratio",)),
    ],
)
def test_advice_on_render_noise_changes_something(
    render: dict[str, Any], advised: tuple[str, ...], not_advised: tuple[str, ...]
) -> None:
    advice = less_render_noise(render)
    assert all(x in advice for x in advised) and not any(x in advice for x in not_advised)


@pytest.mark.parametrize(
    ("values", "lines"),
    [
        ({"exposure_ev": -1.5, "camera.adc.bits": 10}, ["300 ms, -1.5 EV", "bits 10"]),
        ({"exposure_ev": 0, "camera": "bayer"}, ["300 ms", "bayer"]),
        ({"traverse.lamp.value": [0.5, 1.0, 2.0], "view": 3}, ["300 ms", "value 0.5 1 2"]),
    ],
)
def test_a_caption_is_the_time_that_was_exposed_and_what_varies(
    values: dict[str, object], lines: list[str]
) -> None:
    line = Row.model_construct(exposed={"exposed_s": 0.3}, values=values)
    assert caption(line, [*values]) == lines


@pytest.mark.parametrize(("code", "stops"), [(255, 0), (190, 0), (60, 3), (8, 6), (0, 0)])
def test_a_dark_picture_of_a_sheet_is_shown_brighter_by_whole_stops(
    code: int, stops: int
) -> None:
    """After the sRGB curve half of white is 188 of 255, 60 is 4.5 % of white, and 8 is 0.24 %; black stays black."""
    picture, factor = brightened(np.full((4, 5, 3), code, np.uint8))
    expected = srgb_curve(inverse_srgb_curve(np.array(code / 255)) * factor)
    assert factor == 2**stops
    np.testing.assert_array_equal(picture, np.rint(255 * expected).astype(np.uint8))


def test_a_notebook_shows_the_picture_of_a_sample_and_the_splits(made: Path) -> None:
    dataset = ms.Dataset(made)
    sample, shown = dataset[0], dataset[0]._repr_html_()
    assert sample.key[:8] in shown and str(sample.values["exposure_s"]) in shown
    assert base64.b64encode(sample.files["frame.png"]).decode() in shown
    assert f"Dataset of {len(dataset)} samples" in dataset._repr_html_()

"""Frames.minus: the paper's CDS, a frame minus a frame of zero exposure."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mitsuba_sensor as ms

TABLE1 = ms.load_camera("konnik_table1")
STRIPES = TABLE1.replace(
    **{
        "readout.dsnu_col": 0.002,
        "readout.dsnu_row": 0.001,
        "pixel.dsnu_e": 30.0,
        "adc.bits": 16,
    }
)
"""Fixed offsets of 66, 33 and 30 electrons, 131, 66 and 60 DN; 6 electrons of read noise."""

SILENT = STRIPES.replace(
    **{"readout.reset": "true_cds", "source_follower.white_nv_per_rthz": 0.0}
)
ZERO = ms.Exposure(0.0)
DARKNESS = np.zeros((200, 200))


def test_fixed_patterns_cancel_exactly_where_nothing_is_temporal() -> None:
    frames, reference = (ms.expose(DARKNESS, SILENT, ZERO, seed=seed) for seed in (1, 2))
    assert frames.digital.std() > 100
    assert not frames.minus(reference).any()


OTHERS = {
    "serial": (SILENT, {"serial": 2}, r"konnik_table1, serial 2, from pixel \(0, 0\)"),
    "datasheet": (
        SILENT.replace(**{"pixel.dsnu_e": 31.0}),
        {},
        r"konnik_table1, .*\(the datasheet differs\)",
    ),
    "camera": (SILENT.replace(name="another"), {}, "the reference of another, serial 1"),
    "part of the sensor": (
        SILENT,
        {"origin": (0, 5)},
        r"pixel \(0, 5\) \(the part of the sensor differs\)",
    ),
}


@pytest.mark.parametrize("name", OTHERS)
def test_frames_of_another_chip_are_refused_with_both_named_for_their_patterns_do_not_cancel(
    name: str,
) -> None:
    camera, how, sentence = OTHERS[name]
    frames, reference = (
        ms.expose(DARKNESS, SILENT, ZERO),
        ms.expose(DARKNESS, camera, ZERO, **how),
    )
    if name != "camera":
        assert (frames.digital.astype(int) - reference.digital).std() > 1
    with pytest.raises(
        ms.InputError,
        match=rf"frames are of konnik_table1, serial 1, .*{sentence}.*same camera",
    ):
        frames.minus(reference)


def test_what_is_left_of_two_equal_frames_is_temporal_noise_times_the_root_of_two() -> None:
    """40 000 pixels: 5 standard errors of σ are 1.8 %; a tenth of the fixed pattern left would be 100 %."""
    frames, reference = (ms.expose(DARKNESS, STRIPES, ZERO, seed=seed) for seed in (1, 2))
    temporal = frames.report["stages"][-1]["sigma_temporal_expected"]
    left = frames.minus(reference)[0]
    assert temporal > 10, "rounding must not be what is looked at"
    assert left.std() == pytest.approx(math.sqrt(2) * temporal, rel=0.018)
    assert left.mean() == pytest.approx(0.0, abs=5 * math.sqrt(2) * temporal / 200)


def test_one_reference_serves_a_stack_and_a_stack_is_taken_in_pairs() -> None:
    stack, references = (
        ms.expose(np.full((4, 5), 500.0), TABLE1, ZERO, frames=3, seed=seed) for seed in (1, 2)
    )
    one = ms.expose(np.full((4, 5), 500.0), TABLE1, ZERO, seed=2)
    pairs, by_one = stack.minus(references), stack.minus(one)
    for index in range(3):
        frame = stack.digital[index].astype(int)
        np.testing.assert_array_equal(pairs[index], frame - references.digital[index])
        np.testing.assert_array_equal(by_one[index], frame - one.digital[0])


def test_frames_of_equal_temporal_noise_are_refused_and_the_way_out_works() -> None:
    """The same numbers of one seed and exposure, also of a stack, or in other light; what else differs is enough."""
    light, dark = np.full((4, 5), 500.0), np.zeros((4, 5))
    stack = ms.expose(light, TABLE1, ms.Exposure(0.1), frames=3, first_frame=4, seed=6)
    for first_frame, frames in ((4, 3), (2, 3), (6, 3), (4, 1), (6, 1)):
        same = ms.expose(
            dark, TABLE1, ms.Exposure(0.1), frames=frames, first_frame=first_frame, seed=6
        )
        shared = max(first_frame, 4)
        with pytest.raises(
            ms.InputError,
            match=rf"share frame {shared} of seed 6 .*seed, or with first_frame=7\.$",
        ):
            stack.minus(same)
    for how in (
        {"first_frame": 7, "seed": 6},
        {"first_frame": 1, "seed": 6, "frames": 3},
        {"first_frame": 4, "seed": 5},
    ):
        assert stack.minus(ms.expose(dark, TABLE1, ms.Exposure(0.1), **how)).shape == (3, 4, 5)
    assert stack.minus(ms.expose(dark, TABLE1, ZERO, first_frame=4, seed=6)).shape == (3, 4, 5)
    with pytest.raises(ms.InputError, match="share frame 4"):
        stack.minus(stack)

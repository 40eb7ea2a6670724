"""A camera with several read-outs comes back from frames of each of them."""

from __future__ import annotations

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.bench.virtual_bench import Setup, virtual_bench

KELVIN = 228.15
SIZE = {"sensor.rows": 96, "sensor.columns": 96}


@pytest.fixture(scope="module")
def camera() -> ms.Camera:
    """A shipped camera, small."""
    return ms.load_camera("scmos_dual_gain").replace(**SIZE)


@pytest.fixture(scope="module")
def twins(camera: ms.Camera) -> ms.lab.ReadoutTwins:
    """Of frames of each of its read-outs."""
    benches = dict[str, ms.lab.Bench]()
    for name, one in camera.readout_cameras.items():
        benches[name] = virtual_bench(one, Setup(KELVIN))
    return ms.lab.fit_readouts(benches)


@pytest.mark.exhaustive
def test_the_twin_combines_like_the_camera(
    camera: ms.Camera, twins: ms.lab.ReadoutTwins
) -> None:
    """Electrons of the linear code within 2 %, their noise within 3 %, on both sides of the hand-over."""
    for name, figures in twins.figures().items():
        read_noise_e = camera.at_readout(name).source_follower.read_noise_e
        assert figures["σ_read"].quantity.value == pytest.approx(read_noise_e, rel=0.1)
    assert [one.of for one in ms.load_camera(twins.tables()).readouts] == ["charge"] * 2
    with pytest.raises(ms.InputError, match="frames are of a read-out 'high'"):
        twins.tables(ms.load_camera("sony_imx490").model_dump())
    twin = ms.load_camera(twins.tables(camera.model_dump()))
    assert ms.load_camera(twin.to_toml()).combined_readouts == twin.combined_readouts
    assert twin.readouts[1].name == "low" and twin.sources["readouts"].startswith("fit")
    light = ms.Photons(
        np.tile([[100.0], [1_000.0], [20_000.0], [60_000.0]], (1, 96)), detected=True
    )
    mean_e, sigma_e = [], []
    for one in (camera, twin):
        frames = ms.expose(light, one, ms.Exposure(0.01, KELVIN))
        stage = one.combined_readouts
        mean_e.append((frames.clean.mean(axis=1) - stage.black_level_dn) / stage.nominal_gain)
        variance = frames.temporal_variance.mean(axis=1)
        sigma_e.append(np.sqrt(variance) / stage.nominal_gain)
    np.testing.assert_allclose(mean_e[1], mean_e[0], rtol=0.02)
    np.testing.assert_allclose(sigma_e[1], sigma_e[0], rtol=0.03)

"""Cameras, maps, plans and lights that contradict themselves, as typed: one InputError each, with value or way out.

Values out of the range of one field are tested by the schema (test_camera.py).
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms

TABLE1 = ms.load_camera("konnik_table1")
KERNEL = [[0.0, 0.02, 0.0], [0.02, 0.92, 0.02], [0.0, 0.02, 0.0]]
SIDE = [[0.0, 0.02, 0.0], [0.0, 0.0, 0.0], [0.0, 0.02, 0.0]]
DIM = np.linspace(1.0, 100.0, 1200).reshape(30, 40)


def table1(**fields: Any) -> ms.Camera:
    """table1(adc__bits=10): Table 1 with fields changed."""
    return TABLE1.replace(**{name.replace("__", "."): x for name, x in fields.items()})


def colours(**fields: Any) -> ms.Camera:
    changes = {f"quantum_efficiency.{name}": x for name, x in fields.items()}
    return ms.load_camera("bayer_2mp").replace(**changes)


def lens(**fields: Any) -> ms.Camera:
    return TABLE1.replace(**{f"lens.{name}": x for name, x in fields.items()})


def readouts(*fields: dict[str, Any], **changes: Any) -> ms.Camera:
    """A camera whose two readouts, a and b, differ by these fields."""
    pairs = [{"name": "ab"[n], "fields": one} for n, one in enumerate(fields)]
    return ms.load_camera("scmos_dual_gain").replace(**{"readouts": pairs, **changes})


def of_maps(**maps: Any) -> ms.Frames:
    return ms.expose(np.ones((12, 17)), TABLE1, ms.Exposure(0.01), maps=maps)


@cache
def plan_of_dim() -> ms.Plan:
    return ms.plan(TABLE1, ms.Exposure(0.1), DIM, 0.02)


def planned(light: Any, time_s: float = 0.1, camera: Any = TABLE1, **options: Any) -> ms.Frames:
    """Frames of this light by a plan for another."""
    return ms.expose(light, camera, ms.Exposure(time_s), plan=plan_of_dim(), **options)


def collect(light: Any, **options: Any) -> ms.Photons:
    return ms.collect(light, TABLE1, ms.Exposure(0.1), **options)


NAMES = {
    name: value
    for name, value in globals().items()
    if name in ("ms", "np", "KERNEL", "SIDE", "DIM", "TABLE1") or callable(value)
}

WRONG = {
    # converter, wells, registers
    "table1(adc__dnl_lsb={'7': -1.01})": "at least -1",
    "table1(adc__dnl_lsb={'0': 0.5})": "from 1 to 4094",
    "table1(adc__dnl_lsb={'4095': 0.5})": "from 1 to 4094",
    "table1(adc__dnl_lsb={'seven': 0.5})": "from 1 to 4094",
    "table1(readout__em_gain=300.0)": "em_stages",
    "table1(readout__em_gain=300.0, readout__em_stages=4)": "16",
    "table1(readout__ipc_coupling=0.2, readout__ipc_corner_coupling=0.01)": "use smaller",
    "table1(pixel__partial_resets=[[0.9, 6e3], [0.8, 9e3]])": "later",
    "table1(pixel__partial_resets=[[0.9, 6e3], [0.95, 5e3]])": "more",
    "table1(pixel__partial_resets=[[0.5, 6e3]]).without('shot_noise')": "partial_resets",
    "table1(pixel__partial_resets=[[0.5, 6e3]]).emva1288()": "partial_resets",
    "table1(adc__black_level_dn=4095.0).emva1288()": "full scale",
    "table1(source_follower__gain=1e30, readout__cds_gain=1e30)": "at most 1e+30",
    "table1(adc__full_scale_v=1e-30, readout__sense_gain_uv_per_e=1e4)": "at most 1e+30",
    "table1(sensor__technology='ccd', readout__dsnu_col=0.0, readout__ipc_coupling=0.01)": "ipc_coupling to 0",
    "table1(sensor__technology='ccd', readout__reset='soft')": "readout.dsnu_col is 0.001",
    "ms.load_camera('eev_44_82').replace(**{'pixel.dsnu_e': 3.0})": "one amplifier",
    "ms.load_camera('eev_44_82').replace(**{'readout.dsnu_col': 0.001})": "one amplifier",
    # laws of read noise
    "table1(source_follower__read_noise_distribution='tukey_lambda')": "read_noise_shape",
    "table1(source_follower__read_noise_distribution='student', source_follower__read_noise_shape=2.0)": "2.5 to 1000",
    "table1(source_follower__read_noise_shape=0.1)": "normal",
    # neighbours
    "table1(quantum_efficiency__crosstalk=(1.02 * np.array(KERNEL)).tolist())": "1, or less",
    "table1(quantum_efficiency__crosstalk=KERNEL[:2])": "3 rows of 3",
    "table1(quantum_efficiency__crosstalk=np.roll(KERNEL, 1, 0).tolist())": "middle",
    "table1(quantum_efficiency__crosstalk_from={'X': KERNEL})": "'X'",
    "table1(quantum_efficiency__crosstalk=KERNEL, quantum_efficiency__crosstalk_from={'mono': KERNEL})": "either",
    "colours(crosstalk_pairs={'X': {'R': KERNEL}})": "'X'",
    "colours(crosstalk_pairs={'R': {'R': KERNEL, 'X': SIDE}})": "'X'",
    "colours(crosstalk_pairs={'R': {'G': SIDE}})": "has no 'R'",
    "colours(crosstalk_pairs={'R': {'R': KERNEL, 'B': SIDE}})": "row -1",
    "colours(crosstalk_pairs={'R': {'R': [[0.9]]}})": "3 rows of 3",
    "colours(crosstalk_pairs={'R': {}})": "at least 1",
    "table1(quantum_efficiency__diffusion_um=[1.0])": "for 2 wavelengths_nm",
    "table1(quantum_efficiency__diffusion_um=[1.0, 90.0])": "pixels",
    "table1(quantum_efficiency__diffusion_um=[1.0, 1.0], quantum_efficiency__crosstalk=KERNEL)": "either",
    "table1(quantum_efficiency__diffusion_um=[1.0, 1.0], quantum_efficiency__quantum_yield=[2.0, 1.0])": "either",
    "table1(quantum_efficiency__image_lag=0.01, quantum_efficiency__quantum_yield=[2.0, 1.0])": "either",
    "table1(quantum_efficiency__image_lag=0.01, sensor__dual_pixel=True)": "image_lag",
    "table1(quantum_efficiency__image_lag=0.01, readouts=[{'name': 'a'}, {'name': 'b'}])": "image_lag to 0",
    "table1(sensor__dual_pixel=True, pixel__hits_per_cm2_s=1.0)": "dual_pixel",
    "ms.differentiable(DIM, table1(readout__ipc_coupling=0.02), ms.Exposure(0.1), 'photons')": "neighbouring pixels",
    # one gain, gain settings, noise sources
    "table1(adc__full_scale_v=1.0, readout__gain_dn_per_e=0.1)": "not both",
    "table1(readout__sense_gain_uv_per_e=None, readout__gain_dn_per_e=0.1, readout__reset='hard')": "sense_gain_uv_per_e",
    "ms.load_camera('sony_a7s2').at_gain(801)": "gain settings of sony_a7s2 are",
    "ms.load_camera('sony_a7s2').at_gain(True)": "ISO",
    "table1().at_gain(100)": "or use sony_a7s2.",
    "table1().at_gain(77)": "or use eso_feros, hamamatsu_orca_quest_2, moravian_c1_5000, raspberry_pi_hq, sony_a7s2",
    "table1(gains=[{'gain_dn_per_e': 1.0, 'read_noise_e': 1.0}])": "iso",
    "table1(gains=[{'iso': 1, 'name': 'a', 'gain_dn_per_e': 1.0, 'read_noise_e': 1.0}])": "either",
    "table1(gains=[{'iso': 100, 'read_noise_e': 1.0}])": "gain_dn_per_e",
    "table1().without('shotnoise')": "Did you mean 'shot_noise'",
    "table1().without('full_well')": "pixel.full_well_e",
    "table1().without(['prnu'])": "not a noise source",
    # readouts
    "readouts({})": "2 to 8",
    "readouts({}, {'sensor.rows': 5})": "sensor.rows",
    "readouts({}, {'adc.bits': 99})": "adc.bits",
    "readouts({}, {'adc.bit': 10})": "adc.bit ",
    "table1(readouts=[{'name': 'a'}, {'name': 'a'}])": "name",
    "table1(readouts=[{'name': 'a', 'of': 'exposure'}, {'name': 'b'}])": "first of readouts",
    "table1(readouts=[{'name': 'a'}, {'name': 'b', 'gap_us': 3}])": "gap_us",
    "readouts({'readout.gain_dn_per_e': 0.1}, {'readout.gain_dn_per_e': 1.0})": "sensitive",
    **{
        f"ms.load_camera('scmos_dual_gain').{call}": "scmos_dual_gain"
        for call in ("emva1288()", "at_readout('middle')")
    },
    "ms.fpn_maps('scmos_dual_gain', (8, 8))": "scmos_dual_gain",
    "ms.expose(DIM, 'scmos_dual_gain', ms.Exposure(0.1), maps={'prnu': DIM})": "scmos_dual_gain",
    "ms.differentiable(DIM, 'scmos_dual_gain', ms.Exposure(0.1), ('photons',))": "scmos_dual_gain",
    # maps
    "of_maps(prnv=np.ones((12, 17)))": "Did you mean 'prnu'",
    "of_maps(prnu=np.ones((12, 16)))": "(12, 17)",
    "of_maps(dsnu_row_e=np.ones((1, 17)))": "(12, 1)",
    "of_maps(prnu_col=np.ones((12, 1)))": "(1, 17)",
    "of_maps(prnu='flat')": "not numeric",
    "of_maps(dsnu_col_e=np.full((1, 17), np.inf))": "infinite",
    "of_maps(dark_fpn=np.full((12, 17), -0.1))": "negative",
    "of_maps(dsnu_pixel=np.zeros((1, 1)))": "Did you mean 'dsnu_pixel_e'",
    "of_maps(dsnu_pixel_e=np.zeros((1, 1)), dsnu_pixel_dn=np.zeros((1, 1)))": "names both",
    # plans
    "planned(DIM, 0.2)": "0.2 s",
    "planned(np.full((30, 40), 45e3))": "light",
    "planned(np.where(DIM == 1.0, 200.0, DIM))": "120",
    "planned(np.full((31, 40), 50.0))": "31 × 40",
    "planned(DIM, maps={'dsnu_col_e': np.ones((1, 40))})": "dsnu_col_e",
    "planned(DIM, tolerance_dn=0.1)": "tolerance",
    "planned(DIM, camera='bayer_2mp')": "another camera",
    # light
    "collect(-DIM)": "negative",
    "collect(np.array(0.01))": "(H, W)",
    "collect([[1.0], [1.0, 2.0]])": "rows of different",
    "collect(ms.Photons(DIM))": "Photons",
    "collect(np.ones((2, 3, 2)))": "pass wavelengths_nm",
    "collect(np.ones((2, 3, 2)), wavelengths_nm=[600, 500])": "rising",
    "collect(np.ones((2, 3, 1)), wavelengths_nm=[600])": "bandwidths_nm",
    "collect(np.ones((2, 3, 2)), wavelengths_nm=[500, 600], bandwidths_nm=[0, 1])": "bandwidths_nm is 0",
    "collect(DIM, wavelengths_nm=5.5e-7)": "nanometres",
    "ms.uniform_light(-1.0, (2, 2))": "irradiance_w_per_m2 is",
    "ms.uniform_light(1.0, 3)": "shape is 3",
    "ms.Metering(percentile=101.0)": "percentile",
    "ms.snr_curve('sony_imx174', electrons=[0.0])": "electrons",
    "ms.snr_curve('sony_imx174', electrons=[])": "electrons",
    "ms.Metering(share=0.0)": "share",
    # lenses
    "lens(transmission_curve=[0.5, 1.0])": "or neither",
    "lens(transmission_wavelengths_nm=[700, 400], transmission_curve=[0.5, 1.0])": "increase",
    "lens(relative_illumination=[0.9, 0.5], relative_illumination_heights_mm=[0.0, 5.0])": "start with 1",
    "lens(distortion_percent=[0.0, -1.0], distortion_heights_mm=[1.0, 2.0])": "start with 0",
    "lens(distortion=[0.1, 0, 0, 0, 0], distortion_percent=[0.0, -1.0], distortion_heights_mm=[0.0, 2.0])": "either",
    "lens(focus_m=2.0)": "prescription",
    "lens(prescription='double_gauss', distortion=[0.1, 0, 0, 0, 0])": "determines distortion",
    "table1(pixel__angular_response=[1.0, 0.5])": "or neither",
    "table1(pixel__angular_response=[0.9, 0.8], pixel__angular_response_deg=[0.0, 3.0])": "0.9",
    "table1(pixel__angular_response=[1.0, 0.8], pixel__angular_response_deg=[1.0, 3.0])": "begin at 0",
}


@pytest.mark.usefixtures("few_windows")
@pytest.mark.parametrize("call", WRONG)
def test_a_contradiction_is_one_sentence(call: str) -> None:
    with pytest.raises(ms.InputError) as error:
        eval(call, NAMES)
    assert WRONG[call] in str(error.value), str(error.value)
    assert "\n" not in str(error.value)

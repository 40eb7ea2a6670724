"""Terms of data sheets and standards for the keys of a camera file, for what is proposed where a key is not known."""

from __future__ import annotations

import re
from collections.abc import Iterable

from ..core import closest

GAIN = "readout.gain_dn_per_e"
TERMS = {
    GAIN: "k gain system_gain overall_system_gain camera_gain gain_dn gain_adu sensor_gain dn_per_e adu_per_e",
    "readout.sense_gain_uv_per_e": (
        "conversion_gain cvf charge_conversion_gain sense_node_gain uv_per_e conversion_gain_uv_per_e"
    ),
    "source_follower.read_noise_e": (
        "read_noise readout_noise temporal_dark_noise dark_noise sigma_d sigma_read noise_floor temporal_noise"
    ),
    "pixel.full_well_e": (
        "full_well full_well_capacity fwc well well_depth well_capacity saturation saturation_capacity "
        "mu_e_sat u_e_sat charge_capacity linear_full_well"
    ),
    "quantum_efficiency.value": "qe eta quantum_efficiency peak_qe efficiency",
    "dark_current.rate_e_per_s": (
        "dark_current dark_rate dark_signal dark_current_rate mu_i u_i u_i_mean mu_i_mean dark_e_per_s"
    ),
    "dark_current.at_temperature_k": "dark_temperature reference_temperature dark_current_temperature",
    "dark_current.doubling_k": "doubling_temperature t_d doubling",
    "dark_current.cv": "dcnu dark_current_nonuniformity dark_fpn",
    "adc.bits": (
        "bits bit_depth bitdepth adc_bits resolution_bits adc_resolution quantisation quantization digitization"
    ),
    "adc.black_level_dn": "black_level offset dark_level bias bias_level black blacklevel",
    "adc.full_scale_v": "full_scale adc_range adc_full_scale reference_voltage",
    "pixel.pitch_x_um": "pixel_pitch pitch pixel_size pixel_width pitch_um pixel_size_um pitch_x size_x",
    "pixel.pitch_y_um": "pixel_height pitch_y size_y",
    "pixel.fill_factor": "fillfactor ff",
    "pixel.prnu": "prnu prnu1288 photo_response_nonuniformity gain_nonuniformity",
    "pixel.dsnu_e": "dsnu dsnu1288 dark_signal_nonuniformity offset_nonuniformity",
    "readout.row_noise_e": "row_noise temporal_row_noise",
    "readout.column_noise_e": "column_noise temporal_column_noise",
    "readout.frame_noise_e": "frame_noise black_level_jitter offset_jitter temporal_frame_noise",
    "sensor.columns": "columns width pixels_x horizontal_pixels x_resolution resolution cols image_width",
    "sensor.rows": "rows height pixels_y vertical_pixels y_resolution lines image_height",
    "sensor.row_time_us": "row_time line_time",
    "lens.f_number": "f_number fnumber aperture f_stop f",
    "lens.focal_length_mm": "focal_length focal_length_mm",
}
"""Key → terms that mean it, apart by blanks."""
ONE_OVER = {
    "inverse_gain",
    "inverse_k",
    "conversion_factor",
    "e_per_dn",
    "e_per_adu",
    "gain_e_per_dn",
    "gain_e_per_adu",
}
"""Terms for electrons per DN, which are one over the gain."""
MEANT = {term: key for key, terms in TERMS.items() for term in terms.split()}
MEANT |= dict.fromkeys(ONE_OVER, GAIN)
UNIT = re.compile(r"_(?:e|dn|um|nm|v|uv|k|c|s|us|percent|pct|electrons|adu|bit)$")


def key_meant(name: str, known: Iterable[str]) -> str | None:
    """Return the key that a name of a data sheet means, or of which it is a misspelling.

    name : dotted, ``pixel.full_well`` or ``K``.  known : keys that there are.
    """
    keys = set(known)
    last = _as_term(name.rpartition(".")[2])
    for term in (_as_term(name), last, UNIT.sub("", last)):
        if MEANT.get(term) in keys:
            return MEANT[term]
    return closest(name, sorted(keys))


def proposal(name: str, key: str | None) -> str:
    """Return `` Did you mean …?`` with the key that a name means, or an empty text without a key."""
    if key is None:
        return ""
    if _as_term(name.rpartition(".")[2]) in ONE_OVER:
        return f" Did you mean {key!r}, which is one over the electrons per DN?"
    return f" Did you mean {key!r}?"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return `` Did you mean …?`` with the key that a name means, or an empty text."""
    return proposal(name, key_meant(name, known))


def _as_term(name: str) -> str:
    """Return a name in small letters, with _ between its terms."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")

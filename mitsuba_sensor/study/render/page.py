"""What the render side says: sentences, diagrams, tables, numbers."""

from __future__ import annotations

import math

from ..side import Side
from .parts import (
    Found,
    choice_table,
    diagram,
    frames_table,
    reference_table,
    settings_table,
    sigma_diagram,
)
from .results import FRAME_SIGMA, WITHIN, Result


def page(found: Found) -> Side:
    """The whole side; it has passed if every slope that has a theory follows it and spent frames have the right σ."""
    diagrams = (
        diagram(found, "electrons", "Error of the detected electrons", "relative rms error of a pixel"),
        diagram(found, "irradiance", "Error of the irradiance", "relative rms error of a pixel and band"),
        diagram(found, "dn", "Error of the mean digital number", "rms error of a pixel [DN]"),
        sigma_diagram(found),
    )
    tables = choice_table(found), settings_table(found), frames_table(found), reference_table(found)
    parts = *(one for one in diagrams if one.lines), *(one for one in tables if one.rows)
    data = {
        "render": {
            "tolerance": found.tolerance,
            "series": [one.to_dict() for one in found.results],
            "references": {
                kind: {name: value for name, value in entry.items() if name not in ("arrays", "layers")}
                for kind, entry in found.references.items()
            },
            "choices": [{**vars(one), "words": one.words} for one in found.choices],
            "checks": [{**vars(one), "words": one.words, "found": dict(got)} for one, got in found.checks],
        }
    }
    passed = all(one.verdict != "off" and one.spends_right for one in found.results)
    findings = (_advice(found), _law(found), _front(found), *map(_frames, found.results), _floor(found), _left(found))
    return Side(tuple(filter(None, findings)), passed, parts, data)


def _advice(found: Found) -> str:
    """The words to take."""
    goal = f"For a relative error of {found.tolerance:.3g} of the light of a pixel"
    if not any(one.points("electrons") for one in found.results):
        return f"{goal} any number of samples does: all errors are below the reference's own."
    if not found.choices:
        return f"{goal} no setting is enough; take more light or a larger tolerance."
    if not found.checks:
        best = found.choices[0]
        return f"{goal}: {best.words} ({best.error:.2g} in {best.seconds:.3g} s as the fits tell; too long to check)."
    best, got = found.checks[-1]
    told = f"predicted {best.error:.3g} in {best.seconds:.3g} s, rendered {got['error']:.3g} in {got['seconds']:.3g} s"
    missed = "" if found.reached else "; not reached yet, take more samples"
    return f"{goal}: {best.words} ({told}{missed})."


def _law(found: Found) -> str:
    """Whether the slopes are what theory says."""
    judged = [one for one in found.results if one.verdict]
    off = [one.label for one in judged if one.verdict == "off"]
    if not judged:
        return ""
    slopes = [s.value for one in judged for name in ("electrons", "irradiance") if (s := one.slope(name))]
    span = f", all slopes from {min(slopes):.3f} to {max(slopes):.3f}" if slopes else ""
    return (
        f"The error falls as time to the power −1/2, within {WITHIN:g}, in {len(judged) - len(off)} of {len(judged)} "
        f"settings{span}{'; not in ' + ', '.join(off) if off else ''}."
    )


def _front(found: Found) -> str:
    """Who is on the front."""
    curves = found.curves("electrons")
    if not curves:
        return ""
    labels = dict.fromkeys(curves[c].label for c, _ in found.front("electrons"))
    return f"Electrons: no other setting beats, from the quickest to the most exact, {', '.join(labels)}."


def _frames(result: Result) -> str:
    """How long frames with renders of their own take, spent and plain; "" where none were drawn."""
    framed, spend, plain = result.framed, result.sigma("spend")[:1], result.sigma("plain")[:1]
    if framed is None or not spend:
        return ""
    share = "" if framed.share == 1 else f"; all {1 / framed.share:.3g} times as long at the full exposure"
    needed = "" if result.plain_s is None else f"{FRAME_SIGMA:.0%} after {result.plain_s:.2g} s without, "
    return (
        f"Frames of {framed.time_s:.2g} s, each with a render ({result.label}): after {spend[0].seconds:.2g} s σ is "
        f"off by {spend[0].error:+.1%} ± {spend[0].spread:.1%} with --render-noise compensated, by "
        f"{plain[0].error:+.1%} ± {plain[0].spread:.1%} without; "
        f"{needed}compensable after {result.spent_s:.2g} s{share}."
    )


def _floor(found: Found) -> str:
    entry = found.references["auto"]
    return (
        f"The reference's own error ({entry['samples_per_pixel']} samples per pixel): electrons "
        f"{math.sqrt(entry['electrons']):.2g}, mean {math.sqrt(entry['dn']):.2g} DN; it is taken off every error."
    )


def _left(found: Found) -> str:
    return "" if found.smooth else "Denoising was left out: pip install 'mitsuba-sensor[denoise]'."

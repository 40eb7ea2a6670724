"""Checks of a scene before it is rendered: what is refused, and what differs from what its author probably expects.

checks.py has the table of checks; spectrum_checks.py and built_checks.py have the checks of spectra and of what Mitsuba
has built. A check yields Findings (finding.py). refusals.py stops a render that is impossible. spectra.py finds the
spectra of a parsed scene, infrared.py says what its RGB colours are beyond 700 nm, and electron_share.py weighs what
lies beyond the data.
"""

"""Checks of a scene before it is rendered: what is refused, and what differs from what its author probably expects.

lint.py has the table of checks, of which spectrum_findings.py and built_checks.py have those of spectra and of what
Mitsuba has built; a result of one is a Finding (finding.py). refusals.py stops a render that cannot be.
scene_spectra.py reads the spectra of a parsed scene, and electron_share.py weighs what lies beyond their data.
"""

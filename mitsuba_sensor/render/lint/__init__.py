"""Checks of a scene before it is rendered: rejected scenes, and properties that its author probably does not expect.

checks.py contains the table of checks; spectrum_checks.py and built_checks.py check the spectra and the built scene. A
check yields findings (finding.py). refusals.py rejects scenes that cannot be rendered. spectra.py finds the spectra of
a parsed scene, and infrared.py applies the rules of RGB colours beyond 700 nm.
"""

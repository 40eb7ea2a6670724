"""Checks of a scene before it is rendered: what is refused, and what differs from what its author probably expects.

lint.py puts all checks together; a result of one is a Finding (finding.py). refusals.py stops a render that cannot be.
scene_spectra.py reads the spectra of a parsed scene and spectrum_findings.py checks them; mesh_attributes.py looks at
colours of vertices, metal_tables.py continues tables of metals, electron_share.py weighs what lies beyond the data.
"""

"""Mean photons in, raw frames out.

expose.py prepares an exposure: checks.py and photon_checks.py check what is asked for, choices.py chooses chain and
precision, detection.py makes photoelectrons of the light. run.py then takes every frame through the stages, strip by
strip; frames.py is what comes out. metering.py finds an exposure time, fpn_maps.py shows the fixed patterns,
frame_notes.py says what may surprise.
"""

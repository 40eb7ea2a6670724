"""Mean photons in, raw frames out.

expose.py prepares an exposure: checks.py checks the light, precision.py chooses float32 or float64, and detection.py
computes the photoelectrons. run.py then takes every frame through the stages, strip by strip; frames.py holds the
result. kept_maps.py keeps fixed-pattern maps from call to call and fpn_maps.py shows them, metering.py finds an
exposure time, and frame_notes.py lists possible problems.
"""

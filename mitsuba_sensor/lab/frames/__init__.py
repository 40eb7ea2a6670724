"""Frames to measure: stacks of frames with statistics of each pixel, and how files form stacks.

stack.py is the start: frames of one scene at one setting, with their statistics. manifest.py and bench.py find stacks
in a folder, selection.py chooses stacks for an instrument, series.py sorts exposure levels. temporal.py removes
drifting light, clipping.py counts clipped values, soundness.py rejects benches that would be measured wrongly.
"""

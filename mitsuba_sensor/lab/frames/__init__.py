"""Frames that are measured: which files belong together, and what each pixel of a stack shows.

stack.py comes first: frames of one scene under one setting, with their statistics. manifest.py and bench.py find such
stacks in a folder, selection.py chooses those that an instrument needs, series.py puts levels of light in a row.
temporal.py leaves out light that drifts from frame to frame, clipping.py counts what ADC and full well cut off,
soundness.py refuses benches that would be measured wrongly.
"""

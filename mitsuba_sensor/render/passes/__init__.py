"""Renders of a scene: prepared.py loads the scene and renders passes until stop_criterion.py ends them.

passes.py adds passes up, loaded_render.py computes light from the sums, grouped.py renders light groups, and
per_frame.py makes a render for each frame.
"""

"""Renders of a scene: prepared.py loads it and renders passes until stop_criterion.py ends them.

passes.py sums them, loaded_render.py makes light of the sums, grouped.py renders light groups, and per_frame.py
renders anew for each frame.
"""

"""Scenes that move while the shutter is open, and AOVs of each pixel.

moving_scene.py sets the poses of camera and objects at any time; scene/motion.py reads motions from TOML files. rays.py
intersects one ray per pixel with a scene; aovs.py computes depth, position, normal, albedo, shape index and optical
flow.
"""

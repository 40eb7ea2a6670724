"""Scenes that move while the shutter is open, and AOVs: what each pixel sees.

motion.py reads rigid motions from a TOML file, moving_scene.py puts camera and objects at their poses of any time.
rays.py intersects one ray per pixel with a scene; aovs.py has depth, position, normal, albedo, shape index and optical
flow from them.
"""

"""Mitsuba scenes before they are built, and the requested changes.

parse_scene.py makes a ParsedScene (parsed_scene.py) from a path, XML text, a dict or a loaded scene (loaded_scene.py).
scene_settings.py reads camera, exposure and seeds from it; plugin_parameters.py declares them. asked.py checks options
that change a scene, scene_edits.py applies them, motion.py reads motions. mitsuba_errors.py knows the plugins.
"""

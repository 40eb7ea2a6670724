"""Scenes of Mitsuba before they are built: what a file, a dict or a loaded scene says, and what is asked to change.

parse_scene.py makes a ParsedScene (parsed_scene.py) of a path, XML text, a dict or a loaded scene (loaded_scene.py);
scene_settings.py reads camera, exposure and seeds of it, plugin_parameters.py declares them. asked.py checks options
that change a scene, scene_edits.py applies them, motion.py reads what moves. mitsuba_errors.py knows the plugins.
"""

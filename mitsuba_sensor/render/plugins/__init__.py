"""Plugins for plain Mitsuba: <sensor type="camera">, <film type="photosensor"> and <integrator type="raw_frame">.

plugin_hook.py makes them known to Mitsuba. It is imported with this package, which puts a finder into sys.meta_path for
that, and imports plugins.py (sensor and film) and raw_film.py (raw frames, the integrator) when a scene has one.
"""

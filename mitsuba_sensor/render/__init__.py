"""Light: from a scene to photons. The only room that knows Mitsuba, and variants.py is its one door to it."""

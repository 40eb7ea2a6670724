"""What RGB colours reflect beyond 700 nm, where they say nothing.

materials.py reads the rule that is asked for and the table of measured materials (materials.toml). rgb_colours.py
finds the colours of a parsed scene, rules.py says which rule each one has and puts it into the scene; held_texture.py
is Mitsuba's texture for colours that are not constant.
"""

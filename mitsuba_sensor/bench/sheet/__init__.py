"""The image-quality sheet of a camera: charts in front of it, what instruments measure, and theory beside.

setting : gain and temperature, and how frames are taken.  light : light of a chart, rendered once and kept.
chart : what every chart has.  emva, edge, steps, … : one chart each, with its light, its frames, its instrument and its
theory; charts lists them.  sheet : all of them at all settings, as rows.  page : rows as a page, JSON and CSV.
"""

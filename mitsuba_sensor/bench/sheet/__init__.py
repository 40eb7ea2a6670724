"""The image-quality sheet of a camera: charts in front of it, what instruments measure, and theory beside.

chart : what every chart has.  charts, modulation, patches : the table of charts.  light : their scenes, rendered
once and kept.  optics, closed_forms : theory.  sheet : the loop over charts and settings, and frames of real cameras.
page, comparison : rows as a page, JSON and CSV.
"""

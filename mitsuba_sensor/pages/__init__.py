"""The page writer of studies and laboratory.

page : sentences, tables and pictures as plain values.  series : colours of the series of a page.  drawing : pictures as
SVG and PNG.  html_page : the whole page as one file, from page.html.j2.
"""

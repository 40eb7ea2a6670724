"""The page writer of studies and laboratory.

page : findings, tables and pictures as plain values.  drawing : pictures as SVG and PNG.  html_page : the whole page as
one file, from page.html.j2.
"""

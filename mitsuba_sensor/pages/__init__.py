"""The page writer of the studies and the laboratory.

page : findings, tables and pictures as plain values.  drawing : pictures as SVG and PNG.
html_page : the page as one file, from page.html.j2.
"""

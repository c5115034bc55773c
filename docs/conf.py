# SPDX-License-Identifier: Apache-2.0
"""The site that `make docs` builds from these pages, with Sphinx."""

import os

os.environ['DOCUTILSCONFIG'] = ''  # a machine's own settings do not change the site

project = 'eol_ros'
copyright = 'the authors of eol_ros'
extensions = ['myst_parser']
myst_heading_anchors = 4  # links to headings, as on a forge
smartquotes = False  # options keep their two dashes
html_theme = 'furo'
html_title = 'eol_ros'
html_theme_options = {'source_edit_link': '', 'top_of_page_buttons': []}
html_static_path = ['static']
html_css_files = ['print.css']
html_js_files = ['search.js']
html_copy_source = False
html_show_sourcelink = False


def setup(app):
    """Put the decision records below their index in the menu."""
    menu = '\n```{toctree}\n:hidden:\n:glob:\n\n[0-9]*\n```\n'
    add = lambda _, page, text: text.__setitem__(0, text[0] + menu * (page == 'adr/README'))  # noqa: E731
    app.connect('source-read', add)

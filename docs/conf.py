"""Configuration of the documentation site; `make docs` builds it."""

import sys
from pathlib import Path

import mirte_drake

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "mirte_drake"
version = release = mirte_drake.__version__
html_title = project

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_click",
    "sphinx_copybutton",
    # Our own, in docs/extensions.
    "docstrings",
    "examples",
    "module_pages",
    "pictures",
    "port_picture",
    "static_math",
]
exclude_patterns = ["_build"]

myst_enable_extensions = ["amsmath", "attrs_block", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 90
napoleon_numpy_docstring = False
add_module_names = False
copybutton_exclude = ".linenos, .gp, .go"

html_math_renderer = "static"
html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_copyright = False
html_show_sphinx = False
html_copy_source = False
highlight_language = "text"
smartquotes_action = "q"  # Two dashes begin an option.
pygments_style = "friendly"
pygments_dark_style = "nord"

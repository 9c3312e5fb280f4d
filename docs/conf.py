"""The site, made of the pages in this directory by `make docs`, without the network.

Furo is the theme: it is kept, has no dependency of weight, and loads nothing from other servers.
"""

import os
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util.nodes import make_refnode

import ff_planner_ros

DOCS = Path(__file__).resolve().parent
SOURCE_TREE = DOCS.parent

project = "ff_planner_ros"
author = "ff_planner_ros developers"
release = version = ElementTree.parse(SOURCE_TREE / "package.xml").findtext("version") or ""

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
if os.environ.get("DOCS_ONLINE"):  # links into the docs of others: their lists come by network
    extensions.append("sphinx.ext.intersphinx")
    intersphinx_mapping = {
        "python": ("https://docs.python.org/3", None),
        "numpy": ("https://numpy.org/doc/stable", None),
    }
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4  # as GitHub makes them
nitpicky = True
highlight_language = "none"  # what a command prints

# What is public is what `ff_planner_ros/__init__.py` lists; a name is there when it is first used.
vars(ff_planner_ros).update(
    {name: getattr(ff_planner_ros, name) for name in ff_planner_ros.__all__}
)
default_role = "literal"  # `name` in a docstring
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
napoleon_google_docstring = True

html_theme = "furo"
html_title = f"ff_planner_ros {release}"
html_theme_options = {"top_of_page_buttons": []}
html_math_renderer = "mathml"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False


def setup(app: Sphinx) -> None:
    """Add what Sphinx lacks: formulas without scripts, and links as GitHub follows them."""
    app.add_html_math_renderer("mathml", (_inline_formula, None), (_formula, None))
    app.connect("source-read", _read)
    app.connect("missing-reference", _public_name)


def _inline_formula(self: Any, node: nodes.math) -> None:
    self.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _formula(self: Any, node: nodes.math_block) -> None:
    self.body.append(tex2mathml(node.astext(), as_block=True))
    raise nodes.SkipNode


def _read(app: Sphinx, page: str, text: list[str]) -> None:
    """Let links out of docs/ lead to the page that includes a file, or, of directories, nowhere.

    Other files are offered as they are; what does not exist stays, and Sphinx complains of it.
    """
    folder = Path(app.env.doc2path(page)).parent

    def link(found: re.Match[str]) -> str:
        target = (folder / found[2].partition("#")[0]).resolve()
        outside = target.exists() and not target.is_relative_to(DOCS)
        if outside and (included := DOCS / target.name.lower()).is_file():
            return f"[{found[1]}]({os.path.relpath(included, folder)})"
        return found[1] if outside and (target.is_dir() or target.suffix == ".md") else found[0]

    text[0] = re.sub(r"\[([^\]]*)\]\((\.\.?/[^)]*)\)", link, text[0])


def _public_name(app: Sphinx, _: Any, node: Any, shown: nodes.TextElement) -> Any:
    """Return a reference to a public name where it is public, and text for other classes."""
    if node.get("refdomain") != "py":
        return None
    name = node["reftarget"].rpartition(".")[2]
    known = app.env.domains["py"].objects.get(f"ff_planner_ros.{name}")
    if known is None or name not in ff_planner_ros.__all__:
        return shown
    return make_refnode(app.builder, node["refdoc"], known.docname, known.node_id, shown)

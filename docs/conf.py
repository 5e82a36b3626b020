"""The documentation site: `make docs` builds it into site/, warnings as errors, without a network.

Formulas are plain text: a formula renderer would have to be fetched, or weigh more than all pages together.
"""

import sys
from pathlib import Path

from cableway.core.provenance import versions

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "cableway"
author = "The cableway authors"
version = release = versions()["cableway"]

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "command_line", "registries"]
exclude_patterns = ["_extensions"]

myst_heading_anchors = 3
default_role = "code"

autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
maximum_signature_line_length = 100
napoleon_use_ivar = True
napoleon_attr_annotations = False

# Names of cableway must lead somewhere, but for these, which no user writes; names of others lead out of the site.
INTERNAL = (
    r"(S|\w+State|PlanReference|GripperTracker|Fit|Inputs|LearnedConfig|Network|RodParameters|Windows|ConvexWorld"
    r"|Bounds|Choice|Quantity|HeldRod|Weights)"
)
nitpick_ignore_regex = [("py:.*", r"(?!cableway\.).*"), ("py:.*", rf"cableway\..*\.{INTERNAL}")]

html_theme = "furo"
html_title = f"cableway {release}"
html_copy_source = False


def setup(app):
    """Called by Sphinx: a default that a factory makes is shown as `...`, which can be parsed."""

    def readable(app, what, name, obj, options, signature, returns):
        return signature and signature.replace("<factory>", "..."), returns

    app.connect("autodoc-process-signature", readable)

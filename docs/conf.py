"""
The site, made by `make docs`: Sphinx on the pages as they are in the repository.

Sphinx runs on the whole repository (`sphinx-build -c docs . out/docs/html`), so that the links of
the pages lead to the same places here and there. A new page in docs/ joins CONTENTS.
"""

from pathlib import Path
import re
import shutil
import sys
from typing import Any
from xml.etree import ElementTree

import attrs
from docutils.nodes import SkipNode
from latex2mathml.converter import convert
from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

project = 'nadrc_ros'
author = 'nadrc_ros maintainers'
release = ElementTree.parse(ROOT / 'package.xml').getroot().findtext('version')
extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.napoleon']
root_doc = 'README'
include_patterns = ['*.md', 'CHANGELOG.rst', 'docs/*.md']
myst_heading_anchors = 3
myst_enable_extensions = ['dollarmath', 'html_image']
html_math_renderer = 'mathml'
autodoc_member_order = 'bysource'
autodoc_typehints_format = 'short'
# There is no network at build time: names of other packages cannot be looked up.
nitpick_ignore_regex = [
    ('py:.*', r'(?!nadrc_ros).*'),
    # Types of results, which api.md leaves out.
    (
        'py:(class|mod)',
        r'nadrc_ros\.(tuning|simulation|records|scenario|adrc\.(commission|fields))\..*',
    ),
]

smartquotes = False  # y' is a derivative

html_theme = 'furo'
html_title = f'nadrc_ros {release}'
html_static_path = ['static']
html_css_files = ['wide.css']
html_copy_source = False
html_show_copyright = False

# The pages by purpose; Sphinx names a page that is in none of them.
CONTENTS = {
    'Tutorials': 'docs/tutorial_laptop docs/tutorial_motor docs/tutorial_log',
    'How-to': (
        'docs/install docs/robot docs/first_run docs/troubleshooting docs/commission docs/live '
        'docs/choosing docs/identify docs/tuning docs/compare docs/report docs/recording '
        'docs/wiring docs/axes docs/cascade docs/angles docs/reference docs/delay '
        'docs/known_dynamics docs/vibration docs/gain_table docs/rest docs/applied '
        'docs/feed_forward docs/managed docs/realtime docs/own docs/testing docs/export'
    ),
    'Reference': (
        'docs/parameters docs/commands docs/scenarios docs/files docs/nomenclature docs/api '
        'docs/live_protocol'
    ),
    'Explanation': (
        'docs/observers docs/nesting docs/safety docs/performance docs/architecture docs/paper'
    ),
    'Project': 'CONTRIBUTING CHANGELOG SECURITY QUALITY_DECLARATION docs/cite',
}


def _contents(caption: str, pages: list[str]) -> str:
    """Return one part of the sidebar."""
    return '\n'.join(
        ['', '```{toctree}', ':hidden:', f':caption: {caption}', '', *pages, '```', '']
    )


def _add_contents(_: Sphinx, page: str, source: list[str]) -> None:
    """Give the README the contents of the site, which GitHub would show as they are."""
    if page == root_doc:
        for caption, pages in CONTENTS.items():
            source[0] += _contents(caption, pages.split())


def _copy_start(app: Sphinx, error: Exception | None) -> None:
    """Let the site begin with the README."""
    if error is None and app.builder.name == 'html':
        shutil.copy(Path(app.outdir) / f'{root_doc}.html', Path(app.outdir) / 'index.html')


def _escape(*event: Any) -> None:
    """Take docstrings as the plain text they are: |e| is no substitution, a * b no emphasis."""
    lines: list[str] = event[-1]
    lines[:] = [re.sub(r'([|*])', r'\\\1', line) for line in lines]


def _shorten(_: Sphinx, kind: str, __: str, thing: Any, *___: Any) -> tuple[str, None] | None:
    """Leave the fields of a class out of its signature: they are many, and described elsewhere."""
    return ('(**fields)', None) if kind == 'class' and attrs.has(thing) else None


def _inline_math(writer: Any, node: Any) -> None:
    """Write a formula as MathML, which browsers draw by themselves."""
    writer.body.append(convert(node.astext()))
    raise SkipNode


def _block_math(writer: Any, node: Any) -> None:
    """Write a formula that stands alone."""
    writer.body.append(convert(node.astext(), display='block'))
    raise SkipNode


def setup(app: Sphinx) -> None:
    """Connect the above."""
    app.add_html_math_renderer('mathml', (_inline_math, None), (_block_math, None))
    app.connect('source-read', _add_contents)
    app.connect('autodoc-process-docstring', _escape, priority=900)  # after napoleon
    app.connect('autodoc-process-signature', _shorten)
    app.connect('build-finished', _copy_start)

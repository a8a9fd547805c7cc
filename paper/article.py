"""The article: ``article.html`` filled with what was measured, one file on its own."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from latex2mathml.converter import convert
from markupsafe import Markup
from paper import attribution
from paper.published import TABLE_1
from paper.section import Finding, Result, Section
from paper.table1 import LABELS, plausible

HERE = Path(__file__).parent
DIAGRAM = HERE.parent / 'docs' / 'n_adrc.svg'


def article(
    chosen: Sequence[Section],
    results: Mapping[str, Result],
    svgs: Mapping[str, Mapping[str, str]],
    quick: bool = False,
) -> str:
    """
    Return the article.

    Parameters
    ----------
    chosen, results
        The sections in their order, and the result of each by name.
    svgs
        The pictures of each section, by name and file stem.
    quick
        Whether to say that the numbers are of a quick look.

    """
    pictures = {stem: svg for by_stem in svgs.values() for stem, svg in by_stem.items()}
    text = (
        _environment()
        .get_template('article.html')
        .render(
            sections=chosen,
            results=results,
            found={section.name: section.findings(results[section.name]) for section in chosen},
            pictures={**pictures, 'n_adrc': DIAGRAM.read_text(encoding='utf-8')},
            quick=quick,
            style=Markup((HERE / 'article.css').read_text(encoding='utf-8')),
            numbers=LABELS,
            parts=attribution.LABELS,
            plausible=plausible,
            printed=TABLE_1,
        )
    )
    return text + '\n'


def _environment() -> Environment:
    """Return what the template speaks: it fails on a name that is not there."""
    environment = Environment(
        loader=FileSystemLoader(HERE),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        'tex': lambda text: _mathml(text, 'inline'),
        'display': lambda text: _mathml(text, 'block'),
        'form': lambda number, form: format(number, form).replace('-', '\u2212'),
        'each': _each,
        'span': _span,
        'image': _image,
    }
    return environment


@cache
def _mathml(tex: str, display: str) -> Markup:
    """Return a formula as MathML, which browsers draw without a script."""
    return Markup(convert(tex, display=display))


def _each(found: Finding, form: str, scale: float = 1.0) -> str:
    """Return all values, in order."""
    return ', '.join(f'{scale * value:{form}}' for value in found.values)


def _span(found: Finding, form: str, scale: float = 1.0) -> str:
    """Return the smallest and the largest value, once where they look the same."""
    ends = [f'{scale * value:{form}}' for value in (found.least, found.most)]
    return ends[0] if ends[0] == ends[1] else ' to '.join(ends)


def _image(svg: str) -> str:
    """Return a picture as a data URI, which keeps the names inside it apart from others."""
    return f'data:image/svg+xml;base64,{b64encode(svg.encode()).decode()}'

"""What only the article has: prose around its figures, and formulas in MathML."""

from __future__ import annotations

from html import escape

import attrs


@attrs.frozen(kw_only=True)
class Prose:
    """Ready HTML before and after the figures, and a caption for each figure by stem."""

    before: str
    after: str = ''
    captions: dict[str, str] = attrs.field(factory=dict)


def formula(content: str) -> str:
    """Return displayed MathML."""
    return (
        '<math xmlns="http://www.w3.org/1998/Math/MathML" display="block">'
        f'<mrow>{content}</mrow></math>\n'
    )


def inline(content: str) -> str:
    """Return MathML within a line."""
    return f'<math xmlns="http://www.w3.org/1998/Math/MathML"><mrow>{content}</mrow></math>'


def mi(name: str, below: str = '', above: str = '') -> str:
    """Return a MathML symbol with an index and an exponent or a prime."""
    symbol = f'<mi>{name}</mi>'
    if below and above:
        return f'<msubsup>{symbol}{_token(below)}{_token(above)}</msubsup>'
    if below:
        return f'<msub>{symbol}{_token(below)}</msub>'
    return f'<msup>{symbol}{_token(above)}</msup>' if above else symbol


def hat(name: str, below: str = '') -> str:
    """Return an estimate."""
    symbol = f'<mover accent="true"><mi>{name}</mi><mo>^</mo></mover>'
    return f'<msub>{symbol}{_token(below)}</msub>' if below else symbol


def mo(sign: str) -> str:
    """Return a MathML operator."""
    return f'<mo>{escape(sign)}</mo>'


def mn(number: str) -> str:
    """Return a MathML number."""
    return f'<mn>{number}</mn>'


def fraction(top: str, bottom: str) -> str:
    """Return a MathML fraction."""
    return f'<mfrac><mrow>{top}</mrow><mrow>{bottom}</mrow></mfrac>'


def _token(text: str) -> str:
    if text in ("'", '′'):
        return '<mo>′</mo>'
    return f'<mn>{text}</mn>' if text.isdigit() else f'<mi>{text}</mi>'

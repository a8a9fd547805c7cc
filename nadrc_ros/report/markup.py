"""The few pieces of HTML that a page is made of; pictures are data URIs."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from html import escape

STYLE = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: #1a1a1a; font: 17px/1.55 Georgia, 'Times New Roman',
  'DejaVu Serif', serif; }
main { max-width: 54rem; margin: 0 auto; padding: 2rem 1.1rem 4rem; }
h1, h2, h3, th, td, figcaption, .verdict, .small { font-family: Helvetica, Arial, 'DejaVu Sans',
  sans-serif; }
h1 { font-size: 1.75rem; line-height: 1.2; margin: 0 0 .4rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .6rem; padding-top: .5rem; border-top: 1px solid #ddd; }
p, ul, ol { margin: .7rem 0; }
.small { font-size: .85rem; color: #444; }
.box { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: .86rem; line-height: 1.35; min-width: 100%; }
th, td { padding: .34rem .6rem; text-align: left; vertical-align: top;
  border-bottom: 1px solid #e2e2e2; }
thead th { border-bottom: 2px solid #1a1a1a; }
td.n, th.n { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
td.w { min-width: 13rem; }
td:first-child { min-width: 8rem; }
td.n:first-child { min-width: 0; }
figure { margin: 1.2rem 0; overflow-x: auto; }
figure img { display: block; width: 100%; min-width: 34rem; height: auto; }
figcaption { font-size: .85rem; color: #444; margin-top: .4rem; position: sticky; left: 0; }
.verdict { background: #f2f6f9; border-left: 4px solid #0072b2; padding: .8rem 1rem;
  margin: 1.2rem 0; font-size: .95rem; }
math[display=block] { margin: .8rem 0; overflow-x: auto; overflow-y: hidden; max-width: 100%; }
code { font-size: .88em; }
"""


def document(title: str, body: str, more: str = '') -> str:
    """Return the whole page, which needs nothing else; ``more`` goes at the end of its head."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8"/>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1"/>\n'
        '<link rel="icon" href="data:,"/>\n'
        f'<title>{escape(title)}</title>\n<style>{STYLE}</style>\n{more}</head>\n'
        f'<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n'
    )


def paragraph(text: str) -> str:
    """Return a paragraph of ready HTML."""
    return f'<p>{text}</p>\n'


def heading(text: str, name: str) -> str:
    """Return a heading that can be linked to."""
    return f'<h2 id="{escape(name)}">{escape(text)}</h2>\n'


def verdict(text: str) -> str:
    """Return a box with the answer."""
    return f'<div class="verdict">{text}</div>\n'


def table(
    header: Sequence[str], rows: Iterable[Sequence[str]], words: Sequence[int] = (0,)
) -> str:
    """Return a table of ready HTML cells that scrolls in its box; ``words`` are text columns."""
    head = ''.join(_cell('th', text, i, words) for i, text in enumerate(header))
    lines = [
        '<tr>' + ''.join(_cell('td', text, i, words) for i, text in enumerate(row)) + '</tr>'
        for row in rows
    ]
    body = '\n'.join(lines)
    return (
        '<div class="box" tabindex="0"><table>\n'
        f'<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody></table></div>\n'
    )


def picture(svg: str, caption: str, alt: str) -> str:
    """Return a figure with the SVG inside as an image, which keeps its names apart."""
    data = b64encode(svg.encode()).decode()
    return (
        f'<figure tabindex="0"><img alt="{escape(alt)}" src="data:image/svg+xml;base64,{data}"/>'
        f'<figcaption>{caption}</figcaption></figure>\n'
    )


def _cell(tag: str, text: str, column: int, words: Sequence[int]) -> str:
    kind = 'w' if column in words and tag == 'td' and len(text) > 40 else ''
    kind = kind if column in words else 'n'
    return f'<{tag} class="{kind}">{text}</{tag}>' if kind else f'<{tag}>{text}</{tag}>'

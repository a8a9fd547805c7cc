"""Checks a built site without a network: `python docs/check.py out/docs/html`."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
import re
import sys
from urllib.parse import unquote, urlsplit

REMOTE = re.compile(r'url\(["\']?(?:https?:)?//|@import')


class Page(HTMLParser):
    """The anchors of a page, its links, and what it loads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors = {''}
        self.links: set[str] = set()
        self.loads: set[str] = set()
        self.feed(path.read_text(encoding='utf-8'))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what matters of one tag."""
        values = {name: value or '' for name, value in attrs}
        self.anchors |= {values[name] for name in ('id', 'name') if name in values}
        if tag == 'a' and 'href' in values:
            self.links.add(values['href'])
        elif tag == 'link' and values.get('rel') not in ('canonical', None):
            self.loads.add(values.get('href', ''))
        elif 'src' in values:
            self.loads.add(values['src'])


def problems(site: Path) -> tuple[list[str], set[str]]:
    """Return what is wrong with a site, and the external links, which are not followed."""
    pages = {path.resolve(): Page(path) for path in sorted(site.rglob('*.html'))}
    wrong = [] if pages else [f'{site}: no pages']
    external = set()
    for path, page in pages.items():
        for target in sorted(page.links | page.loads):
            parts = urlsplit(target)
            if parts.scheme in ('data', 'mailto'):
                continue
            if parts.scheme or parts.netloc:
                external.add(target)
                if target in page.loads:
                    wrong.append(f'{path.name}: loads {target}')
                continue
            there = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not there.exists():
                wrong.append(f'{path.name}: {target} leads nowhere')
            elif there in pages and unquote(parts.fragment) not in pages[there].anchors:
                wrong.append(f'{path.name}: {target} has no such anchor')
    for sheet in site.rglob('*.css'):
        if REMOTE.search(sheet.read_text(encoding='utf-8')):
            wrong.append(f'{sheet.name}: loads something from elsewhere')
    return wrong, external


if __name__ == '__main__':
    found, links = problems(Path(sys.argv[1]))
    print(*sorted(links), sep='\n')
    print(f'{len(links)} external links, not followed; {len(found)} problems')
    sys.exit('\n'.join(found) or 0)

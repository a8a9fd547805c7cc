"""What users read is plain, American English: the worst words and turns stay out."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
import re

import pytest

ROOT = Path(__file__).resolve().parents[1]
# What to say instead, by what is not to be said.
WORDS = {
    r'\bno numbers?\b(?! (?:of|or|in)\b)': 'NaN',
    r'\bby thumb\b': 'rule of thumb',
    r'\b(?:is|are|was|were|be|been) told\b': 'gets, knows, is reported, cannot be distinguished',
    r'\b[Bb]eware\b': 'say what is missing',
    r'\bpays? off\b': 'is worth it',
    r'\bper cent\b': 'percent, %',
    r'\banew\b': 'again',
    r'\bas ever\b': 'leave it out',
    r'\bseldom\b': 'rarely, less often',
    r'\bto the letter\b': 'literally',
    r'\bshall\b': 'must, is to',
    r'\bas told\b': 'as given',
    r'\bnobody knows\b': 'is unknown',
    r'\bcomes? to nothing\b': 'has no effect',
    r'\b(?:does|do) not tell\b': 'does not show, contain, determine',
    r', perhaps\b': 'did you mean',
    r"'s own and stays": 'left unchanged',
    r'\w*(?:[Cc]olour|[Bb]ehaviour|[Nn]eighbour|[Ff]avour|[Hh]onour)\w*': '-or',
    r'\w*(?:[Mm]odelled|[Ll]abelled|[Cc]ancelled|[Cc]ancelling|[Tt]ravelled)\w*': 'one l',
    r'\w*(?:ptimis|nitialis|inearis|iscretis|tabilis|ecognis|rganis|inimis|aximis|ormalis)\w*': (
        '-ize'
    ),
    r'\w*(?:[Rr]ealis(?!t)|eneralis|ynchronis|erialis|uantis(?!ed)|pecialis)\w*': '-ize',
    r'\b(?:[Cc]entre|[Ll]icence|[Tt]owards|[Gg]rey|[Ll]earnt|[Mm]isspelt|[Mm]etres?)\b': 'US',
}
# A sentence of a page whose subject is "what ...".
STATEMENT = r'(?:^|[.:;] |\* )What (?!happens|if\b)[^?.|]*\.'
PAGES = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').glob('*.md'))]
SOURCES = sorted((ROOT / 'nadrc_ros').rglob('*.py'))


def prose(page: Path) -> str:
    """Return a page without code, targets of links, names of tests, and titles of works."""
    text = re.sub(r'```.*?```', '', page.read_text(encoding='utf-8'), flags=re.DOTALL)
    text = re.sub(r'<!-- promises -->.*?<!-- end of promises -->', '', text, flags=re.DOTALL)
    text = re.sub(r'`[^`]*`|\]\([^)]*\)|^### \w+$', ' ', text, flags=re.MULTILINE)
    return re.sub(r'\s+', ' ', text)


def messages(tree: ast.Module, commands: bool) -> Iterator[str]:
    """Yield texts for users: strings with a blank in them, no docstrings but those of commands."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    silent = set()
    for node in ast.walk(tree):
        if isinstance(node, documented) and ast.get_docstring(node) is not None:
            is_command = commands and 'Example: ' in (ast.get_docstring(node) or '')
            if not is_command:
                silent.add(node.body[0].value)  # type: ignore[attr-defined]
    for node in ast.walk(tree):
        text = getattr(node, 'value', None) if isinstance(node, ast.Constant) else None
        if isinstance(text, str) and ' ' in text and node not in silent:
            yield re.sub(r'`[^`]*`', ' ', text)


def found(text: str, patterns: dict[str, str]) -> list[str]:
    """Return what is not to be said, with some words around it, and what to say instead."""
    return [
        f'...{text[max(0, match.start() - 30) : match.end() + 30]}...: {instead}'
        for pattern, instead in patterns.items()
        for match in re.finditer(pattern, text)
    ]


@pytest.mark.parametrize('page', PAGES, ids=lambda path: path.name)
def test_pages_are_plain(page: Path) -> None:
    assert found(prose(page), {**WORDS, STATEMENT: 'begin with the subject'}) == []


def test_messages_and_help_are_plain() -> None:
    said = {
        str(path.relative_to(ROOT)): [
            flaw
            for text in messages(
                ast.parse(path.read_text(encoding='utf-8')), path.parent.name == 'cli'
            )
            for flaw in found(text, WORDS)
        ]
        for path in SOURCES
    }
    assert {path: flaws for path, flaws in said.items() if flaws} == {}


PAGES_TO_READ = [page for page in PAGES if page.parent.name == 'docs']


@pytest.mark.parametrize('page', PAGES_TO_READ, ids=lambda path: path.name)
def test_a_page_says_at_its_top_what_its_reader_can_do(page: Path) -> None:
    title, first, *_ = page.read_text(encoding='utf-8').split('\n\n')
    assert title.startswith('# ') and re.search(r'\b[Yy]our?\b', first), first


@pytest.mark.parametrize(
    'text',
    [
        'a measurement that is no number',
        'the law is told so',
        'the behaviour of the loop',
        'it is optimised',
        'ten per cent',
        'a step that shall settle',
    ],
)
def test_a_word_of_the_list_is_found(text: str) -> None:
    assert len(found(text, WORDS)) == 1


@pytest.mark.parametrize(
    'text',
    ['there are no numbers in it', 'a precise promise of noise', 'otherwise `summarise` it'],
)
def test_good_words_are_left_alone(text: str) -> None:
    assert found(text, WORDS) == []

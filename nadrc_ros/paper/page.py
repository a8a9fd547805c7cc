"""The article: one HTML file that needs nothing else, with every claim beside what is measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from nadrc_ros.paper.claims import claims
from nadrc_ros.paper.diagrams import n_adrc
from nadrc_ros.paper.markup import formula, hat, mi, mo, Prose
from nadrc_ros.paper.prose import PROSE
from nadrc_ros.paper.section import Result, Section
from nadrc_ros.report.markup import document, heading, paragraph, picture, table, verdict

TITLE = 'Nested extended state observers: the paper, reproduced and corrected'
PAPER = (
    'W. R. Abdul-Adheem and I. K. Ibraheem, <i>Novel Active Disturbance Rejection Control Based '
    'on Nested Linear Extended State Observers</i>'
)


def page(
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
    parts = [_head(results['fair'], quick), _idea(), heading('Claim by claim', 'claims')]
    parts.append(
        paragraph(
            'The paper does not give the run length, the bandwidths, the gains and some more: '
            'about ten unknowns against ten published numbers. The <b>calibrated scenarios</b> '
            'were fitted to those numbers. They show that the numbers are plausible, not what '
            'the parameters of the paper were.'
        )
    )
    parts.append(
        table(('paper', 'claim', 'measured', 'verdict'), claims(results), words=(0, 1, 2, 3))
    )
    for section in chosen:
        prose = PROSE[section.name](results[section.name])
        parts += [heading(section.title, section.name), *_section(prose, svgs[section.name])]
    parts.append(_foot())
    return document(TITLE, ''.join(parts))


def _section(prose: Prose, svgs: Mapping[str, str]) -> list[str]:
    pictures = [
        picture(svg, prose.captions.get(stem, ''), stem.replace('_', ' '))
        for stem, svg in svgs.items()
    ]
    return [prose.before, *pictures, prose.after]


def _head(fair: Result, quick: bool) -> str:
    look = (
        verdict('<b>A quick look:</b> few seeds; the numbers below scatter and are not checked.')
        if quick
        else ''
    )
    return (
        f'<h1>{TITLE}</h1>\n<p class="small">{PAPER}. Measured with nadrc_ros; the law that runs '
        'here is the one that its ROS 2 node runs.</p>\n' + look + verdict(_verdict(fair))
    )


def _verdict(fair: Result) -> str:
    times = fair['gains']['nested_2']['clean_factor']
    return (
        '<b>The verdict.</b> Nesting is real, and worth about 10 % in noisy tracking and a factor '
        f'of {min(times):.2g} to {max(times):.2g} in tracking without noise when everything is '
        'tuned again under the same effort, with a linear law. It is not worth 70 %. Most of the '
        'improvement in the paper’s table comes from feeding the law with calmer states; its '
        'reduction of the noise-free effort by 7.5 % is not reproduced.'
    )


def _idea() -> str:
    residual = formula(
        mi('L')
        + mo('−')
        + hat('x', '3')
        + mo('−')
        + hat('z', '3')
        + mo('=')
        + _one_minus('1')
        + _one_minus('2')
        + mi('L')
    )
    observer = formula(
        mi('G', 'k')
        + mo('=')
        + '<msup><mrow><mo>(</mo><mfrac>'
        + mi('ω', 'k')
        + '<mrow><mi>s</mi><mo>+</mo>'
        + mi('ω', 'k')
        + '</mrow></mfrac><mo>)</mo></mrow><mn>3</mn></msup>'
    )
    return (
        paragraph(
            'Active disturbance rejection control lumps all that is unknown about a plant into a '
            'total disturbance L, estimates it with a linear extended state observer (LESO) and '
            'cancels it. The paper adds a second, outer observer, which estimates what the first '
            'one leaves:'
        )
        + picture(
            n_adrc(),
            'Figure 2 of the paper, redrawn. The outer observer receives v′, what plant and inner '
            'observer together receive; eq. (20) prints v.',
            'block diagram of N-ADRC',
        )
        + paragraph('For a plant of order 2, what is left of the disturbance is')
        + residual
        + observer
        + paragraph(
            'so that a ramp leaves nothing, where a single observer lags. Above the bandwidths '
            'nesting makes it worse, and it always passes more noise: the comparison that '
            'matters is at equal effort.'
        )
    )


def _one_minus(level: str) -> str:
    return mo('(') + '<mn>1</mn>' + mo('−') + mi('G', level) + mo(')')


def _foot() -> str:
    return heading('Do it again', 'again') + paragraph(
        '<code>make paper</code> measures all of this, writes this page, the pictures and '
        '<code>paper.json</code>, and fails if a number leaves its declared tolerance. The '
        'scenarios are files in <code>config/</code>. How the paper was read and a list of its '
        'errata are in <code>docs/paper.md</code>.'
    )

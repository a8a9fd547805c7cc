"""`nadrc paper`: the paper reproduced, every claim beside what is measured."""

from pathlib import Path
from typing import Annotated, Any, TYPE_CHECKING

from nadrc_ros.cli.failure import complain, reporting, USER_ERROR
import typer

if TYPE_CHECKING:
    from nadrc_ros.paper.section import Section

DESIGNS = 'designs.yaml'


def paper(
    out: Annotated[Path, typer.Option(help='Folder for article, figures and numbers.')] = Path(
        'out/paper'
    ),
    retune: Annotated[
        bool,
        typer.Option(
            '--retune', help='First find the designs of the fair comparison again (long).'
        ),
    ] = False,
    quick: Annotated[
        bool, typer.Option('--quick', help='Few seeds, seconds: for a look, nothing is checked.')
    ] = False,
) -> None:
    """
    Reproduce the paper: every claim beside what is measured.

    Writes index.html, paper.json and the figures. Fails if a number is out of the tolerance that
    its section declares.

    Example: nadrc paper --quick --out look
    """
    with reporting():
        import os

        from nadrc_ros.paper.run import files, measure, sections, violations
        from nadrc_ros.writing import write_whole

        out.mkdir(parents=True, exist_ok=True)
        jobs = os.cpu_count() or 1
        if retune:
            _retune(out, jobs)
        chosen = sections()
        with _Bar(chosen) as bar:
            results = measure(chosen, bar.tell, jobs, quick)
        for name, content in files(chosen, results, quick).items():
            write_whole(out / name, content)
        _print_table_1(results['table1'])
        typer.echo(f'article {out / "index.html"}, numbers {out / "paper.json"}')
        wrong = [] if quick else violations(chosen, results)
        for sentence in wrong:
            complain(f'out of tolerance: {sentence}')
        if wrong:
            complain(f'{len(wrong)} numbers are out of tolerance')
            raise typer.Exit(USER_ERROR)


class _Bar:
    """A progress bar over all sections, each an equal share."""

    def __init__(self, chosen: 'tuple[Section, ...]') -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        columns = (BarColumn(), TimeElapsedColumn(), TextColumn('{task.description}'))
        self.progress = Progress(*columns)
        self.place = {section.name: i for i, section in enumerate(chosen)}
        self.task = self.progress.add_task('', total=len(chosen))

    def tell(self, section: 'Section', share: float) -> None:
        """Show how far a section is."""
        done = self.place[section.name] + share
        self.progress.update(self.task, completed=done, description=section.title)

    def __enter__(self) -> '_Bar':
        self.progress.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.progress.update(self.task, description='')
        self.progress.stop()


def _retune(out: Path, jobs: int) -> None:
    """Find the designs again, write them beside the article, and say whether they are the same."""
    from nadrc_ros.paper.candidates import dump_designs, load_designs
    from nadrc_ros.paper.retune import retune
    from nadrc_ros.writing import write_whole
    from rich.progress import Progress

    with Progress() as progress:
        task = progress.add_task('tuning', total=1.0)
        designs = retune(lambda share: progress.update(task, completed=share), jobs)
    write_whole(out / DESIGNS, dump_designs(designs).encode())
    same = designs == load_designs()
    typer.echo(
        f'{out / DESIGNS}: '
        + ('the committed designs' if same else 'NOT the committed designs, which are used below')
    )


def _print_table_1(result: dict[str, Any]) -> None:
    from nadrc_ros.cli.table import console
    from nadrc_ros.paper.tables import table_1
    from rich.table import Table

    found = table_1(result)
    table = Table(
        title='Table I: paper | calibrated scenario | difference', title_justify='left', box=None
    )
    table.add_column('')
    table.add_column('paper', justify='right')
    for name in found.scenarios:
        table.add_column(name, justify='right')
        table.add_column('', justify='right')
    for row in found.rows:
        table.add_row(*row)
    console().print(table)

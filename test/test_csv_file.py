"""CSV files of other people's tools: read as they were meant, or refused by the line."""

from __future__ import annotations

import csv
import gzip
from io import StringIO
from math import isnan
from pathlib import Path

from hypothesis import example, given, settings, strategies
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.scenario import csv_file
from nadrc_ros.scenario.csv_file import CsvFile, open_csv
from nadrc_ros.scenario.csv_signal import load_column
from nadrc_ros.scenario.user_code import ScenarioError
import pytest

GERMAN = 't [ms];Soll;Ist °C\r\n0;1,5;2\r\n10;1,5;2,25\r\n'
TOLD = 'semicolons between cells, decimal commas, '


def opened(folder: Path, content: str | bytes) -> CsvFile:
    path = folder / 'my log.csv'
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return open_csv(path)


def columns(file: CsvFile) -> list[list[float]]:
    found = file.series(file.names[0], file.names[1:])
    return [found.time.tolist(), *(each.tolist() for each in found.columns.values())]


@pytest.mark.parametrize(
    ('content', 'told'),
    [
        (GERMAN, TOLD + 'UTF-8'),
        ('\ufeff' + GERMAN, TOLD + 'UTF-8 with a byte order mark'),
        (GERMAN.encode('utf-16'), TOLD + 'UTF-16'),
        (GERMAN.encode('latin-1'), TOLD + 'Latin-1'),
        ('sep=;\n' + GERMAN, TOLD + 'UTF-8'),
        (gzip.compress(GERMAN.encode(), mtime=0), TOLD + 'UTF-8'),
        (GERMAN.replace(';', '\t'), 'tabs between cells, decimal commas, UTF-8'),
        (GERMAN.replace('\r\n', '\r'), TOLD + 'UTF-8'),
        ('Logger X7\nSerial;1234\n\n' + GERMAN, TOLD + 'UTF-8'),
        (
            '"t (ms)","Soll","Ist"\n"0","1,5","2"\n"10","1,5","2,25"\n',
            'commas between cells, deci',
        ),
        ('t_ms,r,y\n0,1.5,2\n\n# note, 3\n10,1.5,2.25\n', 'commas between cells, UTF-8'),
        ('# a\nt_ms,r,y\n# b\n0,1.5,2\n# c\n10,1.5,2.25\n#end\n', 'commas between cells, UTF-8'),
        ('# a, b\nt_ms,r,y\n# b\n0,1.5,2\n10,1.5,2.25\n', 'commas between cells, UTF-8'),
        ('# t/ms r y\n  0.  1.5   2 \n 10. +1.5 225e-2\n', 'blanks between cells, UTF-8'),
        ('t|r|y\nms|rpm|rpm\n0|1.5|2\n10|1.5|2.25\n', 'bars between cells, UTF-8'),
        ('t [ms],r,y,\n0,1.5,2,\n10,1.5,2.25,\n', 'commas between cells, UTF-8'),
    ],
)
def test_a_file_is_read_as_it_was_meant(content: str | bytes, told: str, tmp_path: Path) -> None:
    file = opened(tmp_path, content)
    assert file.told.startswith(told)
    found = file.series(file.names[0], file.names[1:3])
    assert found.time == pytest.approx([0.0, 0.01])
    assert [each.tolist() for each in found.columns.values()] == [[1.5, 1.5], [2.0, 2.25]]
    assert not found.cut


@given(
    rows=strategies.lists(
        strategies.lists(
            strategies.floats(allow_nan=False, allow_infinity=False), min_size=3, max_size=3
        ),
        min_size=1,
        max_size=5,
    ),
    separator=strategies.sampled_from(';\t,|'),
    comma=strategies.booleans(),
    quoted=strategies.booleans(),
)
def test_numbers_come_back_to_the_bit(
    rows: list[list[float]],
    separator: str,
    comma: bool,
    quoted: bool,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    text = StringIO()
    writer = csv.writer(
        text, delimiter=separator, quoting=csv.QUOTE_ALL if quoted else csv.QUOTE_MINIMAL
    )
    writer.writerow(['time', 'a', 'b b', 'c'])
    for k, row in enumerate(rows):
        cells = [repr(x) for x in (float(k), *row)]
        writer.writerow([cell.replace('.', ',') for cell in cells] if comma else cells)
    file = opened(tmp_path_factory.getbasetemp(), text.getvalue())
    assert columns(file)[1:] == [list(column) for column in zip(*rows)]


def test_times_may_be_dates_and_a_unit_may_be_given(tmp_path: Path) -> None:
    text = 'time,y\n2026-01-31T23:59:59.5Z,1\n2026-02-01T00:00:00Z,2\n'
    assert opened(tmp_path, text).series('time', 'y').time.tolist()[1] == 1769904000.0
    clock = opened(tmp_path, 'time;y\n09:59:59,750;1\n10:00:00;2\n').series('time', 'y')
    assert clock.time.tolist() == [35999.75, 36000.0]
    plain = opened(tmp_path, 't,y\n1,1\n3,2\n')
    assert plain.unit_of('t') == '' and opened(tmp_path, GERMAN).unit_of('t') == 'ms'
    assert plain.series('t', 'y', 'us').time == pytest.approx([1e-6, 3e-6])


def test_empty_cells_are_unknown_and_other_columns_may_hold_words(tmp_path: Path) -> None:
    file = opened(tmp_path, 't,mode,y,r\n0,AUTO,1,\n1,MANUAL,,NaN\n2,AUTO,3,n/a\n')
    found = file.series('t', ['y', 'r'])
    y, r = found.columns.values()
    assert y.tolist()[::2] == [1.0, 3.0] and isnan(y[1]) and all(map(isnan, r))
    with pytest.raises(UserError, match=r"line 2: mode = 'AUTO' is not a number"):
        file.series('t', ['mode'])


def test_columns_go_by_name_without_the_unit_or_by_number(tmp_path: Path) -> None:
    file = opened(tmp_path, 'Time [ms],Speed (rpm),7\n0,1,2\n10,3,4\n')
    for name in ('Time [ms]', 'time', 'TIME', '1'):
        assert file.place(name) == 0
    assert file.place('speed') == 1 and file.place('7') == file.place('3') == 2
    with pytest.raises(UserError, match=r"no column 'sped': did you mean Speed \(rpm\)\?"):
        file.place('sped')
    with pytest.raises(UserError, match=r"no column '4': there are Time \[ms\], Speed"):
        file.place('4')
    bare = opened(tmp_path, '0,1\n1,2\n')
    assert bare.names == ('1', '2') and 'no heading' in bare.told
    assert opened(tmp_path, 't,h\n0,1\n1,2\n').names == ('t', 'h')  # a height, no unit of hours


def test_a_last_row_that_was_cut_is_left_out_and_any_other_is_named(tmp_path: Path) -> None:
    found = opened(tmp_path, 't,y\n0,1\n1,2\n2').series('t', 'y')
    assert found.cut and found.time.tolist() == [0.0, 1.0]


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('t,y\n0,1\n1,2\n1,3\n', 'line 4: t repeats that of line 3, 1 s'),
        ('t,y\n0,1\n5,2\n\n4,3\n3,3\n', 'line 5: t is before that of line 3, 5 s, .*; 1 more'),
        ('t,y\n0,1\n,2\n', "line 3: t = '' is no time"),
        ('t,y\n0,1\ninf,2\n', "line 3: t = 'inf' is no time"),
        ('t,y\n-1e308,1\n1e308,2\n', "line 2: t = '-1e308' is no time"),
        ('t [h],y\n0,1\n1e308,2\n', "line 3: t = '1e308' is no time"),
        ('t,y\n0,1\n1,x\n', "line 3: y = 'x' is not a number"),
        ('t,y\n0,1\nt,y\n0,1\n', "line 3: t = 't' is not a number"),
        ('t,y\n0,1\n1\n2,3\n', 'line 3: has not 2 cells as the others'),
        ('t,y\n0,1\n1,2,3\n', 'line 3: has not 2 cells as the others; are commas'),
        ('t,y\n0,1,2,3\n0,2,2,4\n', '2 names and 4 numbers in a row: commas'),
        ('time,y\n2026-01-31 12:00:00,1\n31.01.2026,2\n', 'line 3: .*is no date as the first'),
        ('y\n1\n2\n', 'no table of at least two columns'),
        ('', 'no table of at least two columns'),
        ('words, words\nand words\n', 'no table of at least two columns'),
        (bytes(range(256)), 'this is not text'),
        (b'PK\x03\x04' + bytes(9), 'a workbook: save its sheet as CSV'),
        (gzip.compress(GERMAN.encode(), mtime=0)[:-9], 'a gzip file that is broken'),
    ],
)
def test_what_cannot_be_read_is_named_by_its_line(
    text: str | bytes, said: str, tmp_path: Path
) -> None:
    with pytest.raises(UserError, match=said) as caught:
        opened(tmp_path, text).series('1' if said.endswith('first') else 't', 'y')
    assert '\n' not in str(caught.value)


def test_a_remark_above_two_columns_is_no_heading(tmp_path: Path) -> None:
    assert opened(tmp_path, '# a\n0,1\n1,2\n').names == ('1', '2')
    assert opened(tmp_path, '# a\nt,v\n# c\n0,1\n1,2\n').names == ('t', 'v')


@pytest.mark.parametrize('cell', ['inf', '-inf', '1e400', '1e300', '-1e16'])
def test_a_signal_refuses_what_it_cannot_be_by_its_line(cell: str, tmp_path: Path) -> None:
    path = tmp_path / 'log.csv'
    path.write_text(f't,v\n0,1\n# b\n1,{cell}\n2,\n3,0\n')
    with pytest.raises(ScenarioError, match=r'line 4: 2 = .* must be within \+-1e\+15'):
        load_column(str(path), {})


def test_a_signal_refuses_rows_that_are_no_time_apart(tmp_path: Path) -> None:
    path = tmp_path / 'log.csv'
    path.write_text('0,1\n5e-324,1e14\n')
    with pytest.raises(ScenarioError, match='line 2: 1 is less than 1e-09 s after that of line 1'):
        load_column(str(path), {})


def test_a_unit_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="unit of time 'hz': must be one of s, ms, us"):
        opened(tmp_path, 't,y\n0,1\n1,2\n').series('t', 'y', 'hz')


def test_a_file_of_many_blocks_is_one_series(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_file, '_BLOCK', 7)
    lines = [f'{k};{k}' if k < 20 else f'{k};{k},5' for k in range(50)]
    found = opened(tmp_path, 't;y\n' + '\n'.join(lines) + '\n50').series('t', 'y')
    assert found.time.tolist() == list(range(50)) and found.cut
    assert found.columns['y'][-1] == 49.5
    lines[30] = '30;x'
    with pytest.raises(UserError, match="line 32: y = 'x' is not a number"):
        opened(tmp_path, 't;y\n' + '\n'.join(lines)).series('t', 'y')


def test_a_comma_after_a_thousand_whole_numbers_is_that_of_a_number(tmp_path: Path) -> None:
    lines = [f'{k};{k}' for k in range(1100)] + ['1100;0,5']
    found = opened(tmp_path, 't;y\n' + '\n'.join(lines)).series('t', 'y')
    assert found.columns['y'][-1] == 0.5


@settings(max_examples=500)
@given(text=strategies.text(alphabet=';,\t |\n"\'0123456789.-+eEabnt#%/:[]()', max_size=200))
@example(text='t,y\n0,1\n"1,2\n')
@example(text='#\n#,\n1,2')
def test_any_text_is_a_table_or_refused(
    text: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    try:
        file = opened(tmp_path_factory.getbasetemp(), text)
        found = file.series('1', file.names[1:])
    except UserError as error:
        assert '\n' not in str(error)
    else:
        assert all(len(column) == len(found.time) > 0 for column in found.columns.values())

// What is seen as a picture or as rows, the parameters as a file, the run as a report.

import { download, find, make, show_dialog, stamped, typed } from './dom.js';
import { ask } from './link.js';
import { drawn } from './plots.js';
import { about, begin, columns, end, place, time, units } from './samples.js';
import { cursor, span } from './view.js';

const HEADING = 34; // px

function picture() {
  const parts = drawn.filter(({ near, element }) => near || element.offsetParent).map((plot) => ({ plot, canvas: plot.view.export('png', true).canvas }));
  const ratio = parts[0].canvas.width / parts[0].plot.element.clientWidth;
  const whole = document.createElement('canvas');
  whole.width = Math.max(...parts.map(({ canvas }) => canvas.width));
  whole.height = parts.reduce((sum, { canvas }) => sum + canvas.height, HEADING * ratio);
  const context = whole.getContext('2d');
  const style = getComputedStyle(document.body);
  context.fillStyle = style.backgroundColor;
  context.fillRect(0, 0, whole.width, whole.height);
  context.fillStyle = style.color;
  context.font = `${14 * ratio}px ${style.fontFamily}`;
  const text = `${find('#node').textContent}   ${find('#word').textContent}   ${new Date().toLocaleString()}`;
  context.fillText(text, 12 * ratio, 22 * ratio);
  let top = HEADING * ratio;
  const [from, to] = span();
  for (const { plot, canvas } of parts) {
    context.drawImage(canvas, 0, top);
    const share = (cursor - from) / (to - from);
    if (plot.timed && cursor !== null && share >= 0 && share <= 1) {
      const box = plot.view.frame.bbox;
      context.fillRect((box.left + share * box.width) * ratio, top + box.top * ratio, ratio, box.height * ratio);
    }
    top += canvas.height;
  }
  whole.toBlob((blob) => download(stamped('live', 'png'), blob), 'image/png');
}

/** The rows shown, as text: shortest digits that give the same float32 again. */
export function rows_shown() {
  const [from, to] = span();
  const names = [...about.names, 'error'];
  const head = names.map((name) => (units[name] ? `${name} [${units[name]}]` : name));
  const short = (value) => {
    if (Number.isNaN(value)) return '';
    for (let digits = 6; digits < 9; digits++) {
      if (Math.fround(Number(value.toPrecision(digits))) === value) return String(Number(value.toPrecision(digits)));
    }
    return String(Number(value.toPrecision(9)));
  };
  const lines = [['time [s]', ...head].join()];
  for (let row = place(from, time, begin, end); row < end && time[row] <= to; row++) {
    lines.push([time[row].toFixed(6), ...names.map((name) => short(columns[name][row]))].join());
  }
  return `${lines.join('\n')}\n`;
}

async function save() {
  const answer = await ask({ do: 'save' });
  if (!answer.ok) { show_dialog('Not saved', make('p', {}, answer.text)); return; }
  const rows = answer.difference.map(({ name, from, to }) => make('tr', {}, make('th', { scope: 'row' }, name),
    make('td', { className: 'n' }, typed(from)), make('td', { className: 'n' }, typed(to))));
  const head = make('tr', {}, ...['parameter', 'at the start', 'now'].map((each, i) => make('th', { scope: 'col', className: i ? 'n' : '' }, each)));
  show_dialog(`Save ${answer.name}`, make('p', {}, answer.text),
    rows.length ? make('div', { className: 'box' }, make('table', {}, make('thead', {}, head), make('tbody', {}, ...rows))) : null,
    make('div', { className: 'buttons' }, make('button', {
      type: 'button', className: 'main', onclick: () => download(answer.name, new Blob([answer.yaml], { type: 'application/yaml' })),
    }, 'Download')),
    make('details', {}, make('summary', {}, 'The file'), make('pre', { tabIndex: 0 }, answer.yaml)));
}

async function report({ target }) {
  target.disabled = true;
  const answer = await ask({ do: 'report' });
  target.disabled = false;
  if (!answer.ok) { show_dialog('No report', make('p', {}, answer.text)); return; }
  show_dialog('Report of this run', make('p', {}, answer.text || 'It is ready.'),
    make('p', {}, make('a', { href: answer.url, target: '_blank', rel: 'noopener' }, 'Open the report')));
}

find('#png').addEventListener('click', picture);
find('#csv').addEventListener('click', () => download(stamped('live', 'csv'), new Blob([rows_shown()], { type: 'text/csv' })));
find('#save').addEventListener('click', save);
find('#report').addEventListener('click', report);

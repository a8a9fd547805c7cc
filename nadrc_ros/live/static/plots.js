// The plots over time and the spectrum: Bokeh draws what is filled in here.

/* global Bokeh */
import { brief, find, make, steady } from './dom.js';
import { on } from './link.js';
import { before } from './pinned.js';
import { about, begin, columns, end, gaps, latest, marks, place, said, spans, thinned_until, time, units } from './samples.js';
import { density } from './spectrum.js';
import { cursor, on_view, paused, point, span } from './view.js';

const MOST_MARKS = 40;
const NEAR = 1e-3; // s
const SILENT = 0.1; // s without a measurement, and five periods
// What an unknown measurement leaves unknown, beside the signal itself.
const MEASURED = new Set(['y', 'error', 'output_estimate', 'disturbance', ...Array.from({ length: 6 }, (_, k) => `level_${k + 1}`)]);
const HELD = new Set(['command', 'applied']);
const LEAST = 95; // px
const LABELS = 40; // px below the last plot over time
const PEEK = 60; // px of the spectrum that show that there is one
const SPECTRUM_EVERY = 1000; // ms
const STALE = 150; // ms

export const drawn = []; // { name, timed, lines, model, view, element }
const hidden = new Set(['measurement', 'output', 'output_estimate']);
const night = matchMedia('(prefers-color-scheme: dark)');
const colored = [];
let given = null; // what /plots.json says
let parameters = new Map();
let dirty = false;
let drawn_at = 0; // ms
let spectrum_at = 0;

const shade = (light) => (night.matches ? given.dark[light] ?? light : light);

// ---- lines ----

/** The rows from a to b, or of many the lowest, the highest and any break of each stretch. */
function kept(values, a, b, most) {
  const length = Math.ceil((b - a) / most);
  const found = [];
  for (let k = a; k < b; k += length) {
    const last = Math.min(k + length, b);
    if (length < 4) {
      for (let i = k; i < last; i++) found.push(i);
      continue;
    }
    let [low, high, none] = [-1, -1, -1];
    for (let i = k; i < last; i++) {
      if (Number.isNaN(values[i])) none = i;
      else {
        if (low < 0 || values[i] < values[low]) low = i;
        if (high < 0 || values[i] > values[high]) high = i;
      }
    }
    found.push(...[...new Set([low, high, none])].filter((i) => i >= 0).sort((i, j) => i - j));
  }
  return found;
}

function rows([from, to], times = time, low = begin, high = end) {
  return [Math.max(low, place(from, times, low, high) - 1), Math.min(high, place(to, times, low, high) + 1)];
}

function limit(name) {
  const value = parameters.get(name === 'limit_low' ? 'command_min' : 'command_max')?.value;
  return Number.isFinite(value) && Math.abs(value) < 1e15 ? value : null;
}

/** Whether a line is not known during a gap of the signal of a column. */
const breaks = (column) => (name) => name === column || (column === 'measurement' && MEASURED.has(name))
  || (name === 'error' && column === 'reference') || ((name === 'error' || name === 'y') && column === 'output');

/** What a line shows of a span of time, null if there is no such thing. */
function line(name, shown, width) {
  if (name.startsWith('limit')) {
    const value = limit(name);
    return value === null ? null : { x: shown, y: [value, value] };
  }
  const [times, values, low, high] = name === 'before'
    ? [before.time, before.error, 0, before.time.length]
    : [time, columns[name], begin, end];
  if (!values) return null;
  const [a, b] = rows(shown, times, low, high);
  const [x, y] = [[], []];
  const broken = gaps.filter((gap) => gap.end > shown[0] && gap.begin < shown[1] && breaks(gap.column)(name));
  for (const i of kept(values, a, b, Math.max(200, width))) {
    const last = x[x.length - 1];
    if (broken.some((gap) => last < gap.end - NEAR && times[i] > gap.begin + NEAR && times[i] > last)) {
      x.push(last);
      y.push(NaN);
    }
    if (HELD.has(name) && y.length && !Number.isNaN(y[y.length - 1])) { x.push(times[i]); y.push(y[y.length - 1]); }
    x.push(times[i]);
    y.push(values[i]);
  }
  return { x, y };
}

function range(lines) {
  let [low, high] = [Infinity, -Infinity];
  for (const [name, { y }] of lines) {
    if (name.startsWith('limit')) continue;
    for (const value of y) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (!(low <= high)) return null;
  for (const [name, { y }] of lines) { // only limits that the command comes near to
    if (!name.startsWith('limit')) continue;
    const wide = Math.max(high - low, 1e-12);
    if (y[0] < low && low - y[0] < wide) [low] = y;
    if (y[0] > high && y[0] - high < wide) [high] = y;
  }
  const room = 0.07 * (high - low) || 0.1 * Math.abs(high) || 1;
  return [low - room, high + room];
}

/** Grow at once, shrink only when it pays: axes that change all the time cannot be read. */
function scale({ model }, found) {
  if (!found) return;
  const { start, end: top } = model.y_range;
  const [low, high] = found;
  const fits = start <= low && high <= top;
  if (fits && high - low > 0.6 * (top - start)) return;
  model.y_range.setv({ start: fits ? low : Math.min(low, Math.max(start, low - 0.1 * (high - low))),
    end: fits ? high : Math.max(high, Math.min(top, high + 0.1 * (high - low))) });
}

function fill_time(plot, shown) {
  const width = plot.view.frame.bbox.width || 600;
  const lines = [];
  for (const { name, renderer, legend } of plot.lines) {
    const found = name === 'tracking' && parameters.get('tracking_acceleration')?.value === 0 ? null : line(name, shown, width);
    if (legend) legend.hidden = !found || (name === 'before' && !before.time.length);
    renderer.visible = Boolean(found) && !hidden.has(name);
    if (!renderer.visible) continue;
    renderer.data_source.data = found;
    lines.push([name, found]);
  }
  scale(plot, range(lines));
  const inside = ({ begin: a, end: b }) => b > shown[0] && a < shown[1];
  const states = spans.filter((each) => each.state && each.state !== 'in control' && inside(each));
  plot.parts.states.data_source.data = {
    left: states.map((each) => each.begin),
    right: states.map((each) => (each === spans[spans.length - 1] ? Math.max(each.end, shown[1]) : each.end)),
    color: states.map(({ state }) => shade(given.states[state])),
  };
  const mute = about.silent || latest() - about.measured > Math.max(SILENT, 5 / about.rate);
  const now = mute ? [{ begin: about.measured, end: shown[1], column: 'measurement' }] : [];
  const silent = [...gaps, ...now].filter((gap) => inside(gap) && plot.lines.some(({ name }) => breaks(gap.column)(name)));
  plot.parts.gaps.data_source.data = { left: silent.map((each) => each.begin), right: silent.map((each) => each.end) };
  const changes = marks.filter((each) => each.time > shown[0] && each.time < shown[1]).slice(-MOST_MARKS);
  const data = { x: changes.map((each) => each.time), number: changes.map(({ number }) => String(number)) };
  plot.parts.marks.data_source.data = data;
}

// ---- spectrum ----

/** The bandwidths of the loop [rad/s], with their names. */
function bandwidths() {
  const of = (name) => parameters.get(name)?.value;
  const found = [['controller', of('controller_bandwidth')], ['inner', of('inner_bandwidth')]];
  const levels = columns.level_2 ? Object.keys(columns).filter((name) => name.startsWith('level_')).length : 1;
  let level = of('outer_bandwidth');
  for (let k = 2; k <= levels; k++, level *= of('bandwidth_ratio')) found.push([k === 2 ? 'outer' : `level ${k}`, level]);
  return found.filter(([, value]) => value > 0).sort(([, a], [, b]) => a - b);
}

function fill_spectrum(plot, shown) {
  spectrum_at = performance.now();
  const [a, b] = rows(shown);
  const found = columns.command && density(time, columns.command, a, b, about.rate);
  const known = bandwidths();
  let note = known.map(([name, value], i) => `${'ABCDEFG'[i]} ${name} ${brief(value)} rad/s`).join(', ');
  if (!found) note = `Too few samples for a spectrum. ${note}`;
  else if (thinned_until > shown[0]) note = `Some samples shown are thinned: the spectrum is rough. ${note}`;
  plot.note.textContent = note;
  if (!found) return;
  const [low, high] = [Math.min(found.x[0], ...known.map(([, value]) => value / 1.5)), found.x[found.x.length - 1]];
  const top = Math.max(...found.y);
  const bottom = Math.max(Math.min(...found.y), top * 1e-8);
  plot.lines[0].renderer.data_source.data = found;
  plot.parts.marks.data_source.data = { x: known.map(([, value]) => value), number: known.map((_, i) => 'ABCDEFG'[i]) };
  if (!(top > 0)) return;
  plot.model.x_range.setv({ start: low, end: high });
  plot.model.extra_x_ranges.hertz.setv({ start: low / (2 * Math.PI), end: high / (2 * Math.PI) });
  const decade = (value, round) => 10 ** round(Math.log10(value));
  plot.model.y_range.setv({ start: decade(bottom, Math.floor), end: 10 * decade(top, Math.ceil) });
}

// ---- values and the cursor ----

function nearest(at) {
  const row = Math.min(place(at), end - 1);
  return row > begin && at - time[row - 1] < time[row] - at ? row - 1 : row;
}

function read_out(shown) {
  const seen = cursor !== null && cursor >= shown[0] && cursor <= shown[1];
  const at = seen ? cursor : shown[1];
  const row = end > begin ? nearest(at) : -1;
  const there = row >= 0 && Math.abs(time[row] - at) < (seen ? 0.1 : 1);
  for (const plot of drawn) {
    for (const { name, value } of plot.lines) {
      if (!value) continue;
      const held = name.startsWith('limit') ? [limit('limit_low'), limit('limit_high')] : null;
      value.textContent = held ? `${brief(held[0])} to ${brief(held[1])}`
        : there && columns[name] ? steady(columns[name][row]) : '';
    }
    if (!plot.timed) continue;
    const box = plot.view.frame.bbox;
    const share = (cursor - shown[0]) / (shown[1] - shown[0]);
    plot.cursor.hidden = !seen;
    const at_px = { left: box.left + share * box.width, top: box.top, height: box.height };
    for (const [side, px] of Object.entries(at_px)) plot.cursor.style[side] = `${px}px`;
  }
  find('#moment').textContent = seen ? `t = ${cursor.toFixed(3)} s` : '';
  const near = 0.01 * (shown[1] - shown[0]);
  const changes = !seen ? [] : marks.filter((mark) => Math.abs(mark.time - cursor) < near).map(({ number, text }) => `${number}: ${text}`);
  const cut = thinned_until > shown[0] && !seen ? ['Thinned: lowest and highest value of each stretch.'] : [];
  find('#said').textContent = [...said(at - 1e-6), ...changes, ...cut].join('; ');
}

function listen(plot) {
  const move = (event) => {
    const box = plot.view.frame.bbox;
    const x = event.clientX - plot.element.getBoundingClientRect().left - box.left;
    const [from, to] = span();
    point(from + Math.min(1, Math.max(0, x / box.width)) * (to - from));
  };
  plot.element.addEventListener('pointermove', move);
  plot.element.addEventListener('pointerdown', move);
  plot.element.addEventListener('pointerleave', (event) => { if (event.pointerType === 'mouse') point(null); });
}

// ---- drawing ----

function draw() {
  dirty = false;
  drawn_at = performance.now();
  if (document.visibilityState !== 'visible') return;
  const shown = span();
  const [first] = drawn;
  first.model.x_range.setv({ start: shown[0], end: shown[1] });
  for (const plot of drawn) {
    if (!plot.near) continue;
    if (plot.timed) fill_time(plot, shown);
    else if (performance.now() - spectrum_at > SPECTRUM_EVERY) fill_spectrum(plot, shown);
  }
  read_out(shown);
}

/** Let the plots over time fill the height there is: all are seen at once, where there is room. */
function fit() {
  const timed = drawn.filter(({ timed: each }) => each);
  const room = find('#plots').clientHeight - find('#plots .bar').offsetHeight - PEEK - LABELS;
  const names = timed.reduce((sum, { element }) => sum + element.parentElement.offsetHeight - element.offsetHeight, 0);
  const free = matchMedia('(min-width: 60.01rem)').matches ? room - names : 0;
  const usual = timed.reduce((sum, { usual: each }) => sum + each, 0);
  timed.forEach((plot, i) => {
    const labels = i === timed.length - 1 ? LABELS : 0;
    plot.model.height = Math.round(Math.max(LEAST, free ? (plot.usual * free) / usual : plot.usual)) + labels;
  });
  redraw();
}

/** Draw with the next frame, once whatever changed. */
export function redraw() {
  if (dirty || !drawn.length) return;
  dirty = true;
  requestAnimationFrame(draw);
}

/** A name beside its line, with its value: pressed, the line is shown. */
function legend({ name, text, color, dash }) {
  const dashes = { solid: 'none', dashed: '6 3', dotted: '2 3', dashdot: '2 3 6 3' }[dash];
  const value = make('span', { className: 'value' });
  const swatch = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
  swatch.setAttribute('class', 'swatch');
  swatch.setAttribute('viewBox', '0 0 26 8');
  swatch.setAttribute('aria-hidden', 'true');
  const stroke = document.createElementNS('http://www.w3.org/2000/svg', 'line');
  const look = { x1: 0, x2: 26, y1: 4, y2: 4, 'stroke-width': 2.5, 'stroke-dasharray': dashes };
  for (const [key, each] of Object.entries(look)) stroke.setAttribute(key, each);
  stroke.style.stroke = `var(--${color.slice(1)})`;
  swatch.append(stroke);
  const button = make('button', {
    type: 'button', className: 'toggle', 'aria-pressed': String(!hidden.has(name)),
    onclick: () => {
      if (!hidden.delete(name)) hidden.add(name);
      button.setAttribute('aria-pressed', String(!hidden.has(name)));
      redraw();
    },
  }, swatch, make('span', {}, text), value);
  button.hidden = true;
  return { button, value };
}

function remember(model) {
  for (const property of model) {
    const value = property.is_unset ? null : property.get_value();
    const color = value && typeof value === 'object' && 'value' in value ? value.value : value;
    if (typeof color === 'string' && color in given.dark) colored.push({ property, light: color });
  }
}

function paint() {
  for (const { property, light } of colored) property.obj[property.attr] = shade(light);
  redraw();
}

function place_of(plot, described) {
  const names = make('div', { className: 'legend' });
  plot.element = make('div', { className: 'canvas', role: 'img', 'aria-label': `plot of ${described.name}` });
  plot.note = make('figcaption');
  const figure = make('figure', { className: described.timed ? 'timed' : '' }, names, plot.element, plot.note);
  plot.lines = described.lines.map((each) => {
    const { button, value } = described.timed && each.text ? legend(each) : {};
    if (button) names.append(button);
    return { name: each.name, text: each.text, legend: button, value };
  });
  if (described.timed) {
    plot.cursor = plot.element.appendChild(make('div', { className: 'cursor', hidden: true }));
  }
  find('#drawn').append(figure);
}

export async function start() {
  given = await (await fetch('/plots.json')).json();
  Bokeh.logger.set_level('error');
  const whole = Bokeh.require('document').Document.from_json(given.document);
  for (const model of whole._all_models?.values() ?? whole.all_models) remember(model);
  const plots = given.plots.map((described) => ({ name: described.name, timed: described.timed }));
  plots.forEach((plot, i) => place_of(plot, given.plots[i]));
  const views = await Bokeh.embed.add_document_standalone(whole, document.body, plots.map(({ element }) => element));
  plots.forEach((plot, i) => {
    plot.model = whole.roots()[i];
    plot.view = views.get(plot.model);
    plot.usual = plot.model.height;
    plot.parts = {};
    for (const renderer of plot.model.renderers) {
      const known = plot.lines.find(({ name }) => name === renderer.name);
      if (known) known.renderer = renderer;
      else plot.parts[renderer.name] = renderer;
    }
    if (plot.timed) listen(plot);
  });
  const sight = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) drawn.find(({ element }) => element === target).near = isIntersecting;
    redraw();
  }, { rootMargin: '100px' });
  drawn.push(...plots);
  for (const { element } of drawn) sight.observe(element);
  paint();
  night.addEventListener('change', paint);
  on('samples', () => { if (!paused()) redraw(); });
  on('state', () => { if (!paused() && performance.now() - drawn_at > STALE) redraw(); }); // time goes on
  on_view(() => { spectrum_at = 0; redraw(); });
  addEventListener('resize', fit);
  on('hello', () => requestAnimationFrame(fit)); // which lines there are
  fit();
}

/** Let the plots know what the parameters are. */
export function set_parameters(known) {
  parameters = known;
  spectrum_at = 0;
  const unit = (name) => (units[name] ? ` [${units[name]}]` : '');
  const titles = { 'output y': unit('measurement'), 'error e': unit('measurement'), 'command u': unit('command') };
  for (const { name, model } of drawn) if (name in titles) model.left[0].axis_label = name + titles[name];
  redraw();
}


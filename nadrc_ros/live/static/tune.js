// Sliders for the parameters that matter most, on logarithmic scales around where they began.

import { brief, find, make, mind_typing, show_value, tell, typed } from './dom.js';
import { drag, known, on_change, parsed, pending, propose, refuse, value_of } from './parameters.js';

const STEPS = 1000;
const DECADES = 1; // to either side
const CAP = 'command cap';
const rows = new Map(); // name: { slider, field, was, low, high, error, unlocked }
let cap_from = null; // the limits of the command at the start

const is_bandwidth = (name) => name.endsWith('_bandwidth');

/** The limits of the command for a cap: both shrink alike. */
function capped(cap) {
  const largest = Math.max(...cap_from.map(Math.abs));
  return { command_min: (cap_from[0] * cap) / largest, command_max: (cap_from[1] * cap) / largest };
}

const cap_of = (read) => Math.max(Math.abs(read('command_min')), Math.abs(read('command_max')));
const running = (name) => (name === CAP ? cap_of((each) => known.get(each).value) : known.get(name).value);
const wanted = (name) => (name === CAP ? cap_of(value_of) : value_of(name));
const changed = (name) => (name === CAP ? pending.has('command_min') || pending.has('command_max') : pending.has(name));

function rounded(value) {
  return Number(value.toPrecision(3));
}

/** Propose a value; with the ratio kept, all bandwidths by the same factor. */
function set(name, value) {
  if (name === CAP) { propose(capped(value)); return; }
  if (!is_bandwidth(name) || !find('#keep').checked) { propose({ [name]: value }); return; }
  const factor = value / value_of(name);
  const others = [...rows.keys()].filter((each) => is_bandwidth(each) && each !== name);
  propose({ ...Object.fromEntries(others.map((each) => [each, Number((value_of(each) * factor).toPrecision(4))])), [name]: value });
}

function place(row, value) {
  return Math.round((STEPS * Math.log(Math.abs(value) / row.low)) / Math.log(row.high / row.low));
}

/** Show the decade around a value; a value that leaves it takes the scale along. */
function frame(row, value, { low, high } = {}) {
  const size = Math.abs(value) || 1;
  row.low = rounded(Math.max(size * 10 ** -DECADES, low > 0 ? low : 0));
  row.high = rounded(Math.min(size * 10 ** DECADES, high > 0 ? high : Infinity));
  row.ends.replaceChildren(make('span', {}, brief(row.low, 3)), make('span', {}, brief(row.high, 3)));
}

function slid(name) {
  const row = rows.get(name);
  const size = rounded(row.low * (row.high / row.low) ** (row.slider.value / STEPS));
  set(name, name === CAP || running(name) > 0 ? size : -size);
}

function typed_in(name) {
  const row = rows.get(name);
  const value = parsed(name === CAP ? { kind: 'number' } : known.get(name), row.field.value);
  row.field.setAttribute('aria-invalid', String(value === undefined));
  if (value === undefined) return;
  if (name === 'b0' && value * running(name) < 0 && row.locked.checked) {
    refuse('b0 keeps its sign: a wrong sign drives the loop away. Unlock the sign to change it.');
    row.field.value = typed(running(name));
    return;
  }
  if (name === CAP && value <= 0) { refuse('A cap of the command is above 0.'); return; }
  set(name, value);
}

function build(name, { text, unit, low, high }) {
  const id = `tune-${name.replace(/\W/g, '-')}`;
  const words = name.replaceAll('_', ' ');
  const row = {
    slider: make('input', {
      type: 'range', min: 0, max: STEPS, step: 1, id, 'aria-describedby': `${id}-was`,
      oninput: () => { drag(true); slid(name); },
      onchange: () => drag(false),
      onpointerup: () => drag(false),
      onblur: () => drag(false),
    }),
    field: make('input', {
      type: 'text', inputMode: 'decimal', autocomplete: 'off', spellcheck: false,
      'aria-label': `${words}${unit ? ` in ${unit}` : ''}`, 'data-name': name, onchange: () => typed_in(name),
    }),
    was: make('span', { className: 'was', id: `${id}-was` }),
    ends: make('div', { className: 'ends', 'aria-hidden': 'true' }),
    locked: null,
  };
  let lock = null;
  if (name === 'b0') {
    row.locked = make('input', { type: 'checkbox', checked: true, id: 'lock' });
    lock = make('label', { className: 'tick' }, row.locked, ' sign locked');
  }
  mind_typing(row.field, () => wanted(name));
  rows.set(name, row);
  frame(row, running(name), { low, high });
  row.element = make('div', { className: 'slider', title: text },
    make('div', { className: 'top' }, make('label', { for: id }, words), lock, make('span', { className: 'space' }), row.was, row.field, make('span', { className: 'unit' }, unit)),
    row.slider, row.ends);
  return row.element;
}

function rebuild() {
  rows.clear();
  const some = [...known.values()].filter((each) => each.group === 'tune' && each.live
    && each.kind === 'number' && each.value !== 0);
  const sliders = some.map((each) => build(each.name, each));
  const limits = ['command_min', 'command_max'].map((name) => known.get(name)?.value);
  if (limits.every((each) => Number.isFinite(each)) && limits.some(Boolean)) {
    cap_from ??= limits;
    const { unit } = known.get('command_max');
    sliders.push(build(CAP, { text: 'largest size of the command: both limits shrink or grow alike', unit }));
  }
  if (!sliders.length) sliders.push(make('p', { className: 'note' }, 'No controller yet.'));
  find('#sliders').replaceChildren(...sliders);
  find('#ratio').hidden = some.filter(({ name }) => is_bandwidth(name)).length < 2;
}

function update(all) {
  if (all) rebuild();
  for (const [name, row] of rows) {
    const value = wanted(name);
    if (Math.abs(value) < row.low || Math.abs(value) > row.high) frame(row, value);
    row.slider.value = place(row, value);
    row.slider.setAttribute('aria-valuetext', brief(value));
    show_value(row.field, value);
    row.element.classList.toggle('changed', changed(name));
    tell(row.was, changed(name) ? `now ${brief(running(name))} →` : '');
  }
}

on_change(update);

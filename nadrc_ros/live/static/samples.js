// What came of the signals, and what happened meanwhile.

import { on } from './link.js';

const LONGEST = 125; // s that are kept
const MOST = 1 << 20; // rows
const HEADER = 24; // bytes
const OWN = ['y', 'error']; // made here: both are unknown where nothing is measured

export const columns = {}; // of Float32Array, by role; levels are level_1, level_2, ...
export const units = {};
export const spans = []; // states: { begin, end, state, text }
export const gaps = []; // { begin, end, text, column }
export const marks = []; // changes of parameters: { time, number, text }
export let time = new Float64Array(0);
export let begin = 0; // rows from begin to end are there
export let end = 0;
export let thinned_until = -Infinity; // samples up to this time are not all that there were
export const about = { period: 0, rate: 100, names: [], columns: {}, measured: -Infinity, silent: false };

let kept = 0;
let fresh = true; // the next hello is the first of its connection

/** Return the first row from a on, at or after a time. */
export function place(at, times = time, low = begin, high = end) {
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] < at) low = middle + 1; else high = middle;
  }
  return low;
}

/** Forget all samples and make room for those of these signals. */
function renew({ signals, rate }) {
  const counts = {};
  about.names = signals.map(({ role }) => {
    counts[role] = (counts[role] ?? 0) + 1;
    if (role === 'level') return `level_${counts.level}`;
    return counts[role] > 1 ? `${role}_${counts[role]}` : role;
  });
  about.columns = Object.fromEntries(signals.map(({ name }, i) => [name, about.names[i]]));
  about.measured = -Infinity;
  about.rate = rate || 100;
  kept = Math.min(MOST, Math.max(1 << 14, Math.ceil(LONGEST * about.rate * 1.1)));
  time = new Float64Array(2 * kept);
  for (const name of [...Object.keys(columns), ...Object.keys(units)]) {
    delete columns[name];
    delete units[name];
  }
  for (const name of [...about.names, ...OWN]) columns[name] = new Float32Array(2 * kept);
  about.names.forEach((name, i) => { units[name] = signals[i].unit ?? ''; });
  [begin, end, thinned_until] = [0, 0, -Infinity];
}

function wrapped(error) {
  return about.period ? error - about.period * Math.round(error / about.period) : error;
}

function room() {
  if (end === time.length) {
    time.copyWithin(0, end - kept, end);
    for (const column of Object.values(columns)) column.copyWithin(0, end - kept, end);
    [begin, end] = [0, kept];
  }
  return end++;
}

function take(buffer) {
  const view = new DataView(buffer);
  const [rows, width, flags] = [4, 8, 12].map((at) => view.getUint32(at, true));
  if (width !== about.names.length + 1 || buffer.byteLength < HEADER + 4 * rows * width) return;
  const t0 = view.getFloat64(16, true);
  const values = new Float32Array(buffer, HEADER, rows * width);
  const own = about.names.map((name) => columns[name]);
  const { reference, measurement, y, error } = columns;
  const output = columns.output ?? measurement; // the error is of the true one, where that is known
  const broken = flags & 6; // dropped blocks, or a gap before the first row
  if (broken && end > begin && rows) {
    const row = room();
    time[row] = (time[row - 1] + t0 + values[0]) / 2;
    for (const column of Object.values(columns)) column[row] = NaN;
  }
  for (let i = 0; i < rows; i++) {
    const row = room();
    time[row] = t0 + values[i * width];
    for (let k = 0; k < own.length; k++) own[k][row] = values[i * width + k + 1];
    const measured = measurement && !Number.isNaN(measurement[row]);
    if (measured) about.measured = time[row];
    y[row] = measured ? output[row] : NaN;
    error[row] = measured && reference ? wrapped(reference[row] - y[row]) : NaN;
  }
  if ((flags & 1) && rows) thinned_until = time[end - 1];
  begin = place(time[end - 1] - LONGEST);
}

/** The name of a state, as the report colors it. */
export function state_of({ mode, cause, enabled, experiment }) {
  if (experiment) return 'ramping'; // it is disabled, and moves
  if (enabled === false || cause === 'disabled') return 'off';
  return { ok: 'in control', holding: 'holding', ramping: 'ramping', safe: 'safe' }[mode] ?? '';
}

function note_state(message) {
  about.silent = message.cause === 'measurement_timeout';
  const state = state_of(message);
  const last = spans[spans.length - 1];
  const same = last && last.state === state && last.text === message.text;
  if (last && message.t - last.end < 1) last.end = message.t;
  if (!same) spans.push({ begin: message.t, end: message.t, state, text: message.text });
  while (spans.length && spans[0].end < message.t - LONGEST) spans.shift();
  while (gaps.length && gaps[0].end < message.t - LONGEST) gaps.shift();
  while (marks.length && marks[0].time < message.t - LONGEST) marks.shift();
}

/** What is said of a moment: states, gaps. */
export function said(at) {
  const states = spans.filter(({ begin: a, end: b, state }) => a <= at && at < b && state !== 'in control');
  const silent = gaps.filter(({ begin: a, end: b }) => a <= at && at < b);
  return [...states, ...silent].map(({ text }) => text);
}

const first = () => (end > begin ? begin : null);
export const earliest = () => (first() === null ? 0 : time[begin]);
export const latest = () => (first() === null ? -Infinity : time[end - 1]);

on('open', () => { fresh = true; });
on('hello', (hello) => {
  const roles = hello.signals.map(({ role, name }) => `${role} ${name}`).join();
  if (fresh || roles !== about.roles) renew(hello);
  about.roles = roles;
  about.rate = hello.rate || about.rate;
  if (fresh) for (const list of [spans, gaps, marks]) list.length = 0;
  fresh = false;
  const period = hello.parameters.find(({ name }) => name === 'measurement_period');
  about.period = period ? period.value : 0;
});
on('samples', take);
on('state', note_state);
on('event', (event) => {
  if (event.kind !== 'gap') return;
  const known = gaps.find(({ begin: a, column }) => a === event.from && column === about.columns[event.signal]);
  const gap = { begin: event.from, end: event.to ?? event.t, text: event.text, column: about.columns[event.signal] };
  if (known) Object.assign(known, gap); else gaps.push(gap);
});

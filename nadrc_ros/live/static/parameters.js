// The parameters as they run, and the changes to them that wait to be applied together.

import { say, typed } from './dom.js';
import { ask, on } from './link.js';

const PREDICT_AFTER = 200; // ms without a further change
const SETTLED_AFTER = 500; // ms

export const known = new Map(); // name: { name, kind, value, low, high, unit, text, live, group, ... }
export const pending = new Map(); // name: value
export const outcome = { text: '', prediction: null }; // why something was refused; what is predicted
let node = null;
const listeners = [];
let asked = null;
let dragging = false;

/** Call a function whenever a value, a pending change, an outcome or the set of parameters changed. */
export const on_change = (listener) => listeners.push(listener);
const changed = (all = false) => listeners.forEach((listener) => listener(all));

const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);
export const value_of = (name) => (pending.has(name) ? pending.get(name) : known.get(name)?.value);

/** Read what was typed for a parameter; undefined where it is none of its kind. */
export function parsed({ kind, choices }, text) {
  const number = (each) => (each.trim() === '' || !Number.isFinite(Number(each)) ? undefined : Number(each));
  if (kind === 'flag') return typeof text === 'boolean' ? text : undefined;
  if (kind === 'choice') return choices.includes(text) ? text : undefined;
  if (kind === 'text') return text;
  const clean = String(text).replaceAll('−', '-');
  if (kind === 'numbers') {
    const all = clean.split(/[,;\s]+/).filter(Boolean).map(number);
    return all.length && !all.includes(undefined) ? all : undefined;
  }
  const value = number(clean);
  return kind === 'integer' && !Number.isInteger(value) ? undefined : value;
}

function predict_soon() {
  clearTimeout(asked);
  if (dragging) return; // dragging sends nothing
  asked = setTimeout(predict, PREDICT_AFTER);
}

async function predict() {
  const answer = await ask({ do: 'predict', values: Object.fromEntries(pending) });
  outcome.prediction = answer;
  changed();
}

/** A slider is being dragged, or was let go. */
export function drag(on_) {
  dragging = on_;
  if (!on_) predict_soon();
}

/** Let changes wait: { name: value }. */
export function propose(values) {
  for (const [name, value] of Object.entries(values)) {
    if (same(value, known.get(name)?.value)) pending.delete(name);
    else pending.set(name, value);
  }
  outcome.text = '';
  changed();
  predict_soon();
}

/** Something was refused here, before it was sent. */
export function refuse(text) {
  outcome.text = text;
  changed();
}

export function drop() {
  const some = pending.size > 0;
  pending.clear();
  outcome.text = '';
  if (some) say('dropped');
  changed();
  predict_soon();
  return some;
}

/** Forget changes that were applied, unless they were moved on; usually they came back as parameters. */
function settle(values) {
  for (const [name, value] of Object.entries(values)) if (same(pending.get(name), value)) pending.delete(name);
  changed();
}

export async function apply() {
  if (!pending.size) return;
  const values = Object.fromEntries(pending);
  const answer = await ask({ do: 'apply', values });
  if (answer.ok) {
    outcome.text = '';
    say(`applied: ${Object.keys(values).join(', ')}`);
    setTimeout(() => settle(values), SETTLED_AFTER);
  } else {
    const refused = answer.refused && pending.has(answer.refused) ? [answer.refused] : Object.keys(values);
    refused.forEach((name) => pending.delete(name)); // it springs back
    outcome.text = answer.text;
  }
  changed();
  predict_soon();
}

/** Go back to the values of before the last change, or to those with which this session began. */
export async function back(to) {
  pending.clear();
  const answer = await ask({ do: 'back', to });
  outcome.text = answer.ok ? '' : answer.text;
  say(answer.text);
  changed();
}

function change_text(values, before) {
  return Object.entries(values).map(([name, value]) => {
    const old = before[name];
    return old === undefined || same(old, value) ? `${name} = ${typed(value)}`
      : `${name} ${typed(old)} → ${typed(value)}`;
  }).join(', ');
}

on('hello', (hello) => {
  if (hello.node !== node) pending.clear();
  node = hello.node;
  known.clear();
  for (const each of hello.parameters) known.set(each.name, each);
  for (const name of [...pending.keys()]) if (!known.has(name)) pending.delete(name);
  changed(true);
  predict_soon();
});
on('event', ({ kind, node: source }) => { if (kind === 'started' && source === 'page') drop(); });
on('parameters', (message) => {
  const { values } = message;
  message.text = change_text(values, message.before); // for those who come later
  for (const [name, value] of Object.entries(values)) {
    if (known.has(name)) known.get(name).value = value;
    if (pending.has(name) && same(pending.get(name), value)) pending.delete(name);
  }
  changed();
  predict_soon();
});

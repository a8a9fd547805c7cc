// All parameters, with a search: what they mean, their unit and range, and what they are.

import { brief, find, make, mind_typing, show_value, tell, typed } from './dom.js';
import { known, on_change, parsed, pending, propose, refuse, value_of } from './parameters.js';

const rows = new Map(); // name: { element, input, was, given }

function allowed({ kind, low, high, unit, choices, live }) {
  const parts = [];
  if (kind === 'choice') parts.push(`one of ${choices.join(', ')}`);
  else if (Number.isFinite(low) && Number.isFinite(high)) parts.push(`${brief(low)} to ${brief(high)}`);
  if (kind === 'integer') parts.push('whole numbers');
  if (kind === 'numbers') parts.push('a list, with commas');
  if (unit) parts.push(unit);
  if (!live) parts.push('fixed at start');
  return parts.join(' · ');
}

function edited(given, text) {
  const value = parsed(given, text);
  if (value === undefined) refuse(`${given.name}: “${text}” is not of its kind (${allowed(given)}).`);
  else propose({ [given.name]: value });
}

function input_for(given) {
  const shared = { id: `list-${given.name}`, 'aria-describedby': `list-${given.name}-about` };
  if (given.kind === 'flag') {
    return make('input', { ...shared, type: 'checkbox', onchange: ({ target }) => edited(given, target.checked) });
  }
  if (given.kind === 'choice') {
    const options = given.choices.map((each) => make('option', { value: each }, each));
    return make('select', { ...shared, onchange: ({ target }) => edited(given, target.value) }, ...options);
  }
  const numeric = given.kind === 'number' || given.kind === 'integer';
  return mind_typing(make('input', {
    ...shared, type: 'text', inputMode: numeric ? 'decimal' : 'text', autocomplete: 'off', spellcheck: false,
    onchange: ({ target }) => edited(given, target.value),
  }), () => value_of(given.name));
}

function build(given) {
  const input = given.live ? input_for(given) : make('output', { id: `list-${given.name}` });
  const was = make('span', { className: 'was' });
  const element = make('div', { className: 'parameter' },
    make('div', { className: 'top' }, make('label', { for: input.id }, given.name), make('span', { className: 'space' }), was, input),
    make('p', { className: 'note', id: `list-${given.name}-about` }, given.text, make('span', { className: 'allowed' }, allowed(given))));
  rows.set(given.name, { element, input, was, given });
  return element;
}

function update(all) {
  if (all) {
    rows.clear();
    find('#list').replaceChildren(...[...known.values()].map(build));
    search();
  }
  for (const [name, { element, input, was, given }] of rows) {
    const value = value_of(name);
    element.classList.toggle('changed', pending.has(name));
    tell(was, pending.has(name) ? `now ${typed(known.get(name).value)} →` : '');
    if (given.kind === 'flag' && given.live) input.checked = value;
    else show_value(input, value);
  }
}

function search() {
  const words = find('#search').value.toLowerCase().split(/[\s_]+/).filter(Boolean);
  let count = 0;
  for (const { element, given } of rows.values()) {
    const text = `${given.name.replaceAll('_', ' ')} ${given.name} ${given.text} ${given.unit}`.toLowerCase();
    element.hidden = !words.every((word) => text.includes(word));
    count += !element.hidden;
  }
  tell(find('#found'), words.length ? `${count} of ${rows.size} parameters` : `${rows.size} parameters`);
}

on_change(update);
find('#search').addEventListener('input', search);

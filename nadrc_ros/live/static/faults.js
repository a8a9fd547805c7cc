// Faults of a simulated plant, only there where the peer is one.

import { find, make, tell, typed } from './dom.js';
import { ask, on } from './link.js';

let shown = '';

function build({ name, text, unit, value, low, high }) {
  const field = value === null || value === undefined ? null : make('input', {
    type: 'text', inputMode: 'decimal', value: typed(value), autocomplete: 'off', 'aria-label': `${text}, size${unit ? ` in ${unit}` : ''}`,
    title: low === null || low === undefined ? '' : `${low} to ${high}`,
  });
  const answer = make('p', { className: 'refusal', role: 'alert' });
  const button = make('button', {
    type: 'button', 'data-fault': name,
    onclick: async () => {
      const message = { do: 'fault', name, on: button.getAttribute('aria-pressed') !== 'true' };
      if (field) message.value = Number(field.value.replace('−', '-'));
      const { ok, text: why } = await ask(message);
      tell(answer, ok ? '' : why);
    },
  }, text);
  return make('div', { className: 'fault' }, button, field, field && make('span', { className: 'unit' }, unit), answer);
}

on('hello', ({ faults = [], simulated }) => {
  const some = Boolean(simulated && faults.length);
  find('#tab-faults').hidden = !some;
  if (!some && document.body.dataset.tab === 'faults') find('#tab-tune').click();
  const names = faults.map(({ name }) => name).join();
  if (names !== shown) find('#buttons').replaceChildren(...faults.map(build));
  shown = names;
  for (const { name, on: acting } of faults) {
    const button = [...document.querySelectorAll('[data-fault]')].find((each) => each.dataset.fault === name);
    button.setAttribute('aria-pressed', String(acting));
  }
});

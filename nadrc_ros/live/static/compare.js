// Before and after: pin, swap, back, and the figures of merit of both.

import { brief, find, make, say, tell } from './dom.js';
import { ask, on } from './link.js';
import { back } from './parameters.js';
import { forget } from './pinned.js';
import { earliest, latest } from './samples.js';
import { span } from './view.js';

const WORDS = {
  itae: ['ITAE', 'integral of t |e|'], isu: ['ISU', 'integral of u²'], iae: ['IAE', 'integral of |e|'],
  ise: ['ISE', 'integral of e²'], itse: ['ITSE', 'integral of t e²'], rmse: ['RMS error', ''],
  max_error: ['largest error', ''], peak_error: ['peak error', ''], max_command: ['largest |u|', ''],
  total_variation: ['total variation of u', 'how far the actuator travels'],
  saturated_fraction: ['time at a limit', 'share of the stretch'],
};

function table({ before, after }) {
  const span_of = (part) => (part ? `${part.from.toFixed(1)} to ${part.to.toFixed(1)} s` : '–');
  const rows = Object.entries(before.figures).map(([name, was]) => {
    const is = after?.figures[name];
    const change = was && Number.isFinite(is) ? `${is >= was ? '+' : '−'}${brief(Math.abs(100 * (is / was - 1)), 2)} %` : '';
    const [words, title] = WORDS[name] ?? [name.replaceAll('_', ' '), ''];
    return make('tr', { title }, make('th', { scope: 'row' }, words), make('td', { className: 'n' }, brief(was)),
      make('td', { className: 'n' }, brief(is)), make('td', { className: 'n' }, change));
  });
  const head = (text, more) => make('th', { scope: 'col', className: 'n' }, text, make('span', { className: 'unit' }, more));
  return make('table', {}, make('thead', {}, make('tr', {}, make('td'), head('before', span_of(before)), head('after', span_of(after)), head('change', ''))),
    make('tbody', {}, ...rows));
}

on('comparison', (comparison) => {
  const pinned = Boolean(comparison.before);
  find('#figures').replaceChildren(...(pinned ? [table(comparison)] : []));
  const why = comparison.comparable ? `Over the same stretch of reference; the error is that ${comparison.error ?? 'of the reference'}.` : comparison.why;
  tell(find('#comparable'), pinned ? why || 'Not comparable yet.' : 'Nothing is pinned.');
});

async function request(message, done = '') {
  const answer = await ask(message);
  tell(find('#comparable'), answer.text || done);
  say(answer.text || done);
  return answer.ok;
}

export async function pin() {
  const [from, to] = span();
  await request({ do: 'pin', from: Math.max(from, earliest()), to: Math.min(to, latest()) }, 'Pinned.');
}

export const swap = () => request({ do: 'swap' }, 'Swapped.');

find('#pin').addEventListener('click', pin);
find('#unpin').addEventListener('click', async () => {
  if (!await request({ do: 'unpin' }, 'Nothing is pinned.')) return;
  forget();
  find('#figures').replaceChildren();
});
find('#swap').addEventListener('click', swap);
find('#start').addEventListener('click', () => back('start'));
find('#guard').addEventListener('change', async ({ target }) => {
  if (!await request({ do: 'guard', on: target.checked })) target.checked = !target.checked;
});

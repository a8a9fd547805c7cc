// What waits to be applied, and what it would do to the margins, the noise and the period.

import { brief, find, make, tell, typed } from './dom.js';
import { apply, back, drop, known, on_change, outcome, pending } from './parameters.js';

const span = (pair) => (pair ? `${brief(pair[0], 3)} to ${brief(pair[1], 3)}` : '–');
const times = (factor, unit) => (value) => (Number.isFinite(value) ? `${brief(factor * value, 3)}${unit}` : '–');
// Rows of the prediction: key, words, title, how to write it.
const ROWS = [
  ['stable', 'stable', 'whether the loop is', (value) => ({ true: 'yes', false: 'NO' })[value] ?? '–'],
  ['gain_margin', 'b / b0 from … to', 'the loop is stable for a true gain of this share of b0', span],
  ['phase_margin', 'phase margin', '', times(1, '°')],
  ['delay_margin', 'delay margin', 'the dead time more that it bears', times(1000, ' ms')],
  ['modulus_margin', 'distance from −1', 'of the Nyquist curve; 0.5 is good', times(1, '')],
  ['command_noise', 'noise of u / noise of y', 'standard deviation of the command over that of the measurement', times(1, '')],
  ['period_product', 'w·h', 'largest bandwidth times period', times(1, '')],
];

function predicted() {
  const { prediction } = outcome;
  const [now, then] = [prediction?.now ?? {}, (pending.size && prediction?.pending) || {}];
  find('#prediction tbody').replaceChildren(...ROWS.map(([key, words, title, write]) => make('tr', { title },
    make('th', { scope: 'row' }, words), make('td', { className: 'n' }, write(now[key])),
    make('td', { className: `n${key === 'stable' && then.stable === false ? ' bad' : ''}` }, pending.size ? write(then[key]) : ''))));
  find('#prediction').hidden = !prediction?.now;
  tell(find('#model'), prediction?.text ?? 'The margins are not predicted.');
}

on_change(() => {
  const { size } = pending;
  tell(find('#count'), size ? `${size} ${size === 1 ? 'change' : 'changes'} pending` : 'No change is pending');
  find('#pending').classList.toggle('some', size > 0);
  find('#apply').disabled = find('#drop').disabled = size === 0;
  find('#changes').replaceChildren(...[...pending].map(([name, value]) => make('li', {},
    `${name}: ${typed(known.get(name)?.value)} → ${typed(value)}`)));
  tell(find('#refusal'), outcome.text);
  predicted();
});

find('#apply').addEventListener('click', apply);
find('#drop').addEventListener('click', drop);
find('#undo').addEventListener('click', () => back('previous'));

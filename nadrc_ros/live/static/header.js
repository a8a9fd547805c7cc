// What the controller does, in words and color; Run, hold to run, and STOP.

import { brief, find, say, tell } from './dom.js';
import { ask, connected, hold, holding, on, release, send } from './link.js';
import { state_of } from './samples.js';

const ANSWER_WITHIN = 500; // ms
const WORDS = { off: 'disabled', 'in control': 'in control', '': 'unknown' };
let hello = null;
let state = null;
let stopped_at = null;
let control = 'Another page has control'; // or why none has
let ran = false; // the loop was enabled since Run was pressed with hold

function warn(text, take = false) {
  find('#banner').hidden = !text;
  tell(find('#banner-text'), text);
  find('#take').hidden = !take;
}

function show_control() {
  if (!hello) return;
  const mine = hello.operator && !hello.read_only && !state?.commissioned;
  for (const set of document.querySelectorAll('fieldset.owned')) set.disabled = !mine;
  for (const id of ['run', 'hold', 'undo']) find(`#${id}`).disabled = !mine || !hello.node;
  document.body.classList.toggle('watching', !mine);
  find('#stop').disabled = hello.read_only;
  if (!hello.node) warn(state?.text ?? 'waiting for the controller');
  else if (hello.read_only) warn('Read only: this page shows, and changes nothing; it cannot stop the loop either.');
  else if (state?.commissioned) warn(`${state.commissioned}: this page watches. STOP ends it.`);
  else if (!mine) warn(`${control}. You watch; STOP works from here too.`, true);
  else warn('');
}

function show_state() {
  const stale = state.level === 'stale';
  const name = state_of(state);
  const word = stale ? 'not heard' : state.experiment ? 'experiment' : WORDS[name] ?? name;
  const since = state.age === null ? '' : `for ${brief(state.age, 2)} s; last: `;
  const why = (stale ? since + state.text : state.experiment || state.text)
    .replace(/^(in control|holding|silent|going to the safe command|at the safe command)(: |; |$)/, '');
  tell(find('#word'), word);
  tell(find('#why'), why === word ? '' : why);
  find('#state').title = state.text;
  find('#state').dataset.state = stale ? 'lost' : name.replace(' ', '-') || 'lost';
  tell(find('#rate'), state.rate === null ? '–' : `${brief(state.rate, 3)} Hz${state.nominal && Math.abs(state.rate / state.nominal - 1) > 0.02 ? ` of ${brief(state.nominal, 3)}` : ''}`);
  tell(find('#missed'), state.missed === null ? '–' : state.periods ? `${state.missed} (${brief(100 * state.missed / state.periods, 2)} %)` : String(state.missed));
  tell(find('#latency'), state.latency === null ? '–' : `${brief(state.latency, 2)} ms${state.latency_p99 ? `, 99 % ${brief(state.latency_p99, 2)}` : ''}`);
  tell(find('#lease'), state.lease === null ? (state.enabled ? 'no: by itself' : 'no') : `yes, ${state.lease.toFixed(2)} s left`);
  find('#run').textContent = state.enabled ? (holding() ? 'Running, held' : 'Running') : 'Run';
  find('#run').setAttribute('aria-pressed', String(Boolean(state.enabled)));
}

function check_stop() {
  if (stopped_at === null || state.t === undefined) return;
  if (state.enabled === false && !state.experiment && state.level !== 'stale') { stopped_at = null; show_control(); return; }
  if (performance.now() - stopped_at > ANSWER_WITHIN) warn('STOP was sent, and the controller does not say that it is disabled: use the emergency stop.');
}

/** Stop the loop: whatever else the page does, and whoever has control. */
export function stop() {
  release('stopped');
  if (hello?.read_only) { say('read only: this page cannot stop the loop'); return; }
  if (!send({ do: 'stop' })) {
    warn('There is no connection: STOP was not sent. Use the emergency stop.');
    return;
  }
  stopped_at = performance.now();
  find('#stop').classList.add('pressed');
  setTimeout(() => find('#stop').classList.remove('pressed'), 300);
  say('stop was sent');
}

async function run() {
  const held = find('#hold').checked;
  if (state?.enabled && held === holding()) return;
  ran = false;
  if (held) hold();
  const answer = await ask({ do: 'enable', hold: held });
  if (answer.ok) {
    if (!held) release('it runs by itself now');
    return;
  }
  release('not enabled');
  warn(`${state?.enabled ? 'It runs, and is not held' : 'It was not enabled'}: ${answer.text}`);
}

on('hello', (message) => {
  const first = hello?.node !== message.node;
  hello = message;
  tell(find('#node'), hello.node ?? 'no controller');
  document.title = `${hello.node ?? 'no controller'} – nadrc live`;
  if (first) find('#hold').checked = hello.hold_to_run;
  show_control();
});
on('state', (message) => {
  const before = state;
  state = message;
  if (before?.commissioned !== state.commissioned || (!hello?.node && before?.text !== state.text)) show_control();
  ran ||= holding() && state.enabled === true;
  if (ran && state.enabled === false) { ran = false; release('the loop was disabled'); }
  show_state();
  check_stop();
});
on('operator', (message) => {
  if (hello) hello.operator = message.operator;
  control = message.text;
  if (!message.operator) release('another page has control');
  show_control();
  say(message.text);
});
on('released', (why) => { if (why !== 'stopped' && why !== 'not enabled') say(`hold to run ended: ${why}`); });
on('closed', (why) => {
  find('#state').dataset.state = 'lost';
  tell(find('#word'), 'not connected');
  tell(find('#why'), '');
  warn(why);
});
on('open', () => { if (connected()) warn(''); });

find('#stop').addEventListener('click', stop);
find('#stop').addEventListener('pointerdown', stop); // at once, not when it is let go
find('#run').addEventListener('click', run);
find('#hold').addEventListener('change', () => { if (state?.enabled) run(); }); // of a loop that runs, too
find('#take').addEventListener('click', async () => {
  const answer = await ask({ do: 'take_over' });
  if (!answer.ok) warn(answer.text, true);
});

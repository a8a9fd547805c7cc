// The websocket: messages by type, requests with their answers, and the beats of hold to run.

const BEAT = 100; // ms
const IDLE = 1000; // ms
const LONGEST_WAIT = 3000; // ms between attempts to connect

const listeners = new Map();
const waiting = new Map();
let socket = null;
let last_id = 0;
let wait = 250;
let beating = null;
let beats = 0;
let offset = null; // of the clock of the server [s] to that of this page

export const sent = {}; // how many requests of each kind went out

/** Call a function with every message of a type; types of this module: open, closed, samples, released. */
export function on(type, listener) {
  if (!listeners.has(type)) listeners.set(type, []);
  listeners.get(type).push(listener);
}

function emit(type, message) {
  for (const listener of listeners.get(type) ?? []) listener(message);
}

export const connected = () => socket?.readyState === WebSocket.OPEN;

/** The time of the server [s], as far as messages tell. */
export const now = () => (offset === null ? 0 : offset + performance.now() / 1000);

function note_time(t) {
  const seen = t - performance.now() / 1000;
  // The largest is that of the message that came fastest; it may drift by 0.1 %.
  offset = offset === null ? seen : Math.max(offset - 1e-4, seen);
}

function receive({ data }) {
  if (typeof data !== 'string') { emit('samples', data); return; }
  let message;
  try { message = JSON.parse(data); } catch { return; }
  if (message.type === 'hello' || message.type === 'state') note_time(message.t);
  const done = waiting.get(message.id);
  if (done && (message.type === 'answer' || message.type === 'prediction')) {
    waiting.delete(message.id);
    done(message);
  }
  emit(message.type, message);
}

async function why_not() {
  try {
    const { status } = await fetch('/', { cache: 'no-store' });
    if (status === 403) return 'The server was started anew: open the address that it printed.';
  } catch { /* nobody there: what follows says so */ }
  return 'The server of this page does not answer: what you see is old.';
}

export function connect() {
  offset = null;
  socket = new WebSocket(`${location.protocol === 'https:' ? 'wss:' : 'ws:'}//${location.host}/ws`);
  socket.binaryType = 'arraybuffer';
  socket.addEventListener('message', receive);
  socket.addEventListener('open', () => { wait = 250; emit('open'); send_beat({ idle: true }); });
  socket.addEventListener('close', async () => {
    release('the connection was lost');
    for (const done of waiting.values()) done({ ok: false, text: 'The connection was lost.' });
    waiting.clear();
    emit('closed', await why_not());
    setTimeout(connect, wait);
    wait = Math.min(LONGEST_WAIT, 2 * wait);
  });
}

/** Send a request; false if there is no connection. */
export function send(message) {
  if (!connected()) return false;
  sent[message.do] = (sent[message.do] ?? 0) + 1;
  socket.send(JSON.stringify(message));
  return true;
}

/** Send a request and wait for its answer. */
export function ask(message) {
  last_id += 1;
  const id = last_id;
  if (!send({ id, ...message })) {
    return Promise.resolve({ ok: false, text: 'There is no connection: nothing was sent.' });
  }
  return new Promise((done) => { waiting.set(id, done); });
}

// ---- hold to run: a page that is hidden, frozen, closed or cut off sends no beats ----

export const holding = () => beating !== null;

function send_beat(more = {}) {
  beats += 1;
  send({ do: 'beat', n: beats, time: performance.now(), ...more });
}

function beat() {
  if (document.visibilityState !== 'visible') release('the page is hidden');
  else send_beat();
}

// Without holding anything these tell the server how far the two clocks are apart.
setInterval(() => { if (!holding() && document.visibilityState === 'visible') send_beat({ idle: true }); }, IDLE);

export function hold() {
  if (beating === null) beating = setInterval(beat, BEAT);
  beat();
}

/** Send no more beats, until somebody presses Run again. */
export function release(why) {
  if (beating === null) return;
  clearInterval(beating);
  beating = null;
  emit('released', why);
}

document.addEventListener('visibilitychange', () => {
  if (document.visibilityState !== 'visible') release('the page was hidden');
});
document.addEventListener('freeze', () => release('the page was frozen'));
addEventListener('pagehide', () => release('the page was left'));

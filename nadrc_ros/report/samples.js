// The samples of a report: how they are packed, and which of them are shown.
'use strict';

const SPIKE = 3; // times the width of the middle 99 % is the range with a spike
const START = 0.1; // of a run is its start, which may be cut off
let runs, span, dark;
const shown = { from: 0, to: 0, run: 0, moment: null };

async function unpacked(id) {
  const { textContent } = document.getElementById(id);
  const bytes = Uint8Array.fromBase64?.(textContent) // new, and ten times as quick
    ?? Uint8Array.from(atob(textContent), (sign) => sign.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** The columns, of which the first bytes of all numbers come first. */
function columns_of(kinds, bytes) {
  let begin = 0;
  return kinds.map(([kind, count]) => {
    const [Numbers, wide] = kind === 'single' ? [Float32Array, 4] : [Float64Array, 8];
    const ordered = new Uint8Array(wide * count);
    for (let k = 0; k < wide; k++, begin += count) {
      for (let i = 0; i < count; i++) ordered[i * wide + k] = bytes[begin + i];
    }
    const numbers = new Numbers(ordered.buffer);
    if (kind === 'time') {
      let sum = 0; // of ns
      for (let i = 0; i < count; i++) numbers[i] = (sum += numbers[i]) / 1e9;
    }
    return numbers;
  });
}

/** The first row at or after a time, the number of rows if there is none. */
function place(time, at) {
  let [low, high] = [0, time.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (time[middle] < at) low = middle + 1; else high = middle;
  }
  return low;
}

/** The rows of a run that are shown, with one more on either side. */
function rows(run) {
  const { time } = run.columns;
  return [Math.max(0, place(time, shown.from) - 1), Math.min(time.length, place(time, shown.to) + 1)];
}

/** The rows from a to b, or of many the lowest, the highest and any break of each stretch. */
function kept(values, a, b, most) {
  const length = Math.ceil((b - a) / most);
  const found = [];
  for (let k = a; k < b; k += length) {
    if (length < 4) {
      for (let i = k; i < Math.min(k + length, b); i++) found.push(i);
      continue;
    }
    let [low, high, none] = [-1, -1, -1];
    for (let i = k; i < Math.min(k + length, b); i++) {
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

function line([run, column, held], width) {
  const { time, [column]: values } = runs[run].columns;
  const [a, b] = rows(runs[run]);
  const [x, y] = [[], []];
  for (const i of kept(values, a, b, Math.max(200, width))) {
    if (held && y.length) { x.push(time[i]); y.push(y[y.length - 1]); }
    x.push(time[i]);
    y.push(values[i]);
  }
  return { x, y };
}

/** The lowest and highest value shown of some lines, without a start or spikes that flatten all. */
function range(lines, whole) {
  let [low, high, lateLow, lateHigh] = [Infinity, -Infinity, Infinity, -Infinity];
  const late = span[0] + START * (span[1] - span[0]);
  const some = [];
  for (const [run, column] of lines) {
    const { time, [column]: values } = runs[run].columns;
    let [a, b] = [place(time, shown.from), Math.min(time.length, place(time, shown.to) + 1)];
    if (b - a < 2) [a, b] = rows(runs[run]);
    const step = Math.max(1, Math.floor((b - a) / 2000));
    for (let i = a; i < b; i++) {
      const value = values[i];
      if (Number.isNaN(value)) continue;
      low = Math.min(low, value);
      high = Math.max(high, value);
      if (time[i] < late) continue;
      lateLow = Math.min(lateLow, value);
      lateHigh = Math.max(lateHigh, value);
      if ((i - a) % step === 0) some.push(value);
    }
  }
  if (!(low <= high)) return null;
  const full = [low, high];
  if (!whole) {
    if (lateLow < lateHigh && high - low > 2.5 * (lateHigh - lateLow)) {
      [low, high] = [lateLow, lateHigh];
    }
    some.sort((one, two) => one - two);
    const [least, most] = [0.005, 0.995].map((share) => some[Math.round(share * (some.length - 1))]);
    if (some.length > 200 && most > least && high - low > SPIKE * (most - least)) {
      [low, high] = [least, most];
    }
  }
  const room = 0.06 * (high - low) || 0.1 * Math.abs(high) || 1;
  return { low: low - room, high: high + room, cut: full[0] < low - room || full[1] > high + room, full };
}

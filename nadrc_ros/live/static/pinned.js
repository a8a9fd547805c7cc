// The error of the stretch that was pinned as "before", laid under the newest like stretch.

import { on } from './link.js';
import { begin, columns, end, place, time } from './samples.js';

export const before = { time: new Float64Array(0), error: new Float32Array(0) };
let kept = { from: null, to: null, time: before.time };

export function forget() {
  kept = { from: null, to: null, time: new Float64Array(0) };
  before.time = kept.time;
}

on('comparison', (comparison) => {
  if (!comparison.before) { forget(); return; }
  const { from, to } = comparison.before;
  if (from !== kept.from || to !== kept.to) {
    const [a, b] = [place(from, time, begin, end), place(to, time, begin, end)];
    kept = { from, to, time: time.slice(a, b) };
    before.error = columns.error?.slice(a, b) ?? new Float32Array(0);
  }
  const shift = comparison.after ? comparison.after.from - from : 0;
  before.time = kept.time.map((t) => t + shift);
});

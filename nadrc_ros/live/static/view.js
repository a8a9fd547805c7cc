// Which time is shown: it follows the present, or stands still.

import { now, on } from './link.js';
import { earliest, latest } from './samples.js';

const LATE = 0.2; // s after which time goes on without samples

const shown = { wide: 10, paused: null };
export let cursor = null; // s
const listeners = [];

export const on_view = (listener) => listeners.push(listener);
const changed = () => listeners.forEach((listener) => listener());

/** From when to when [s] is shown. */
export function span() {
  const to = shown.paused ?? Math.max(latest(), now() - LATE);
  return [to - shown.wide, to];
}

export const wide = () => shown.wide;
export const paused = () => shown.paused !== null;

export function set_wide(seconds) {
  shown.wide = seconds;
  changed();
}

export function pause(on_ = !paused()) {
  shown.paused = on_ ? span()[1] : null;
  changed();
}

/** Show an earlier or later part of what is there; that stands still. */
export function move(share) {
  const to = span()[1] + share * shown.wide;
  const newest = Math.max(latest(), now() - LATE);
  shown.paused = Math.min(newest, Math.max(to, earliest() + shown.wide));
  if (share > 0 && shown.paused >= newest) shown.paused = null;
  changed();
}

export function point(at) {
  cursor = at;
  changed();
}

on('open', () => { shown.paused = null; cursor = null; });

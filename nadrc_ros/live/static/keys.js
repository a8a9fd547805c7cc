// The keyboard, and the tabs. Space stops, wherever the focus is: Enter presses buttons.

import { close_dialog, every, find, make, say, show_dialog } from './dom.js';
import { stop } from './header.js';
import { pin, swap } from './compare.js';
import { apply, back, drop } from './parameters.js';
import { cursor, move, pause, point, set_wide, span, wide } from './view.js';

const HELP = [
  ['Space', 'STOP: always, also in a field and with a dialog open'],
  ['Enter', 'apply all pending changes together; on a button: press it; on a tick: set it'],
  ['Esc', 'close a dialog, else drop the pending changes, else take the cursor away'],
  ['Ctrl-Z', 'back to the values of before the last change'],
  ['p', 'pause, and go on'], ['1 2 3 4', 'show 5, 10, 30, 120 s'],
  ['← →', 'cursor; with Shift: an earlier or later part'],
  ['b', 'pin what is shown as “before”'], ['x', 'swap A and B'],
  ['t a c f l', 'Tune, All parameters, Compare, Faults, Log'], ['?', 'these keys'],
];

const tabs = () => every('[role=tab]').filter((tab) => tab.offsetParent);

function choose(tab, focus = false) {
  document.body.dataset.tab = tab.id.slice(4);
  for (const each of every('[role=tab]')) {
    each.setAttribute('aria-selected', String(each === tab));
    each.tabIndex = each === tab ? 0 : -1;
  }
  if (focus) tab.focus();
}

function show_help() {
  show_dialog('Keys', make('table', {}, make('tbody', {}, ...HELP.map(([key, text]) => make('tr', {},
    make('th', { scope: 'row' }, make('kbd', {}, key)), make('td', {}, text))))));
}

function step(count) {
  const [from, to] = span();
  const at = (cursor ?? to) + (count * wide()) / 200;
  point(Math.min(to, Math.max(from, at)));
}

const letters = {
  p: () => pause(), b: pin, x: swap, '?': show_help,
  1: () => set_wide(5), 2: () => set_wide(10), 3: () => set_wide(30), 4: () => set_wide(120),
  t: () => choose(find('#tab-tune'), true), a: () => choose(find('#tab-all'), true),
  c: () => choose(find('#tab-compare'), true), l: () => choose(find('#tab-log'), true),
  f: () => { if (!find('#tab-faults').hidden) choose(find('#tab-faults'), true); },
};

function enter(event) {
  const { target } = event;
  if (target.matches('button:not([role=tab]), a, summary, select')) return; // as usual
  event.preventDefault();
  if (target.matches('input[type=checkbox]')) { target.click(); return; }
  if (target.matches('input')) target.dispatchEvent(new Event('change', { bubbles: true }));
  apply();
}

function press(event) {
  const { target, key } = event;
  if (event.code === 'Space' || key === ' ') {
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) stop();
    return;
  }
  if (event.isComposing) return;
  if (key === 'Enter') { enter(event); return; }
  if (key === 'Escape') {
    if (!close_dialog() && !drop()) point(null);
    return;
  }
  if ((event.ctrlKey || event.metaKey) && key.toLowerCase() === 'z' && !target.matches('#search')) {
    event.preventDefault();
    back('previous');
    return;
  }
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (target.matches('[role=tab]') && /^Arrow(Left|Right)$/.test(key)) {
    const all = tabs();
    choose(all[(all.indexOf(target) + (key === 'ArrowRight' ? 1 : all.length - 1)) % all.length], true);
    event.preventDefault();
    return;
  }
  const slider = target.matches('[type=range]'); // which takes arrows, and no letters
  if (target.matches('input:not([type=checkbox]), select, textarea') && !slider) return;
  const arrow = !slider && { ArrowLeft: -1, ArrowRight: 1 }[key];
  if (arrow) {
    event.preventDefault();
    if (event.shiftKey) move(arrow / 4); else step(arrow);
    return;
  }
  letters[key]?.();
}

export function start() {
  addEventListener('keydown', press, { capture: true });
  // a button acts when Space is let go
  addEventListener('keyup', (event) => { if (event.code === 'Space') event.preventDefault(); }, { capture: true });
  for (const tab of every('[role=tab]')) tab.addEventListener('click', () => choose(tab));
  find('#dialog-close').addEventListener('click', close_dialog);
  find('#help').addEventListener('click', show_help);
  find('#pause').addEventListener('click', () => { pause(); say(''); });
  for (const button of every('[data-wide]')) button.addEventListener('click', () => set_wide(Number(button.dataset.wide)));
  const narrow = matchMedia('(max-width: 60rem)');
  const fit = () => {
    if (narrow.matches) choose(find('#tab-plots'));
    else if (document.body.dataset.tab === 'plots') choose(find('#tab-tune'));
  };
  narrow.addEventListener('change', fit);
  fit();
}

// What happened: events of the nodes and changes of parameters, newest first.

import { find, make } from './dom.js';
import { on } from './link.js';
import './parameters.js'; // first: it says what changed from what
import { marks } from './samples.js';

const MOST = 400;

function add(t, kind, text, node = '') {
  const time = Number.isFinite(t) ? t.toFixed(2) : '';
  find('#events').prepend(make('li', { 'data-kind': kind },
    make('time', {}, time), make('span', { className: 'kind' }, kind), make('span', { className: 'text' }, text),
    node ? make('span', { className: 'node' }, node) : null));
  while (find('#events').children.length > MOST) find('#events').lastChild.remove();
}

on('event', ({ t, kind, text, node }) => add(t, kind, text, node));
on('parameters', ({ t, number, text, source }) => {
  marks.push({ time: t, number, text });
  add(t, `change ${number}`, text, source === 'page' ? 'from this server’s page' : source);
});
on('operator', ({ text }) => add(undefined, 'control', text));
on('guard', ({ text, on: armed }) => {
  find('#guard').checked = armed;
  if (text) add(undefined, 'guard', text);
});

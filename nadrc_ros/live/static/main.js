// Starts the page. Who is imported first takes a message first.

import './samples.js';
import './log.js';
import { known, on_change } from './parameters.js';
import './pinned.js';
import './header.js';
import './tune.js';
import './list.js';
import './pending.js';
import './compare.js';
import './faults.js';
import './save.js';
import { every, find } from './dom.js';
import { start as start_keys } from './keys.js';
import { connect } from './link.js';
import { set_parameters, start as start_plots } from './plots.js';
import { on_view, paused, wide } from './view.js';

function show_view() {
  for (const button of every('[data-wide]')) button.setAttribute('aria-pressed', String(Number(button.dataset.wide) === wide()));
  find('#pause').setAttribute('aria-pressed', String(paused()));
  find('#pause').textContent = paused() ? 'Go on' : 'Pause';
}

start_keys();
on_view(show_view);
show_view();
on_change(() => set_parameters(known));
connect(); // first: STOP must work whatever becomes of the plots
await start_plots();
set_parameters(known);
document.documentElement.dataset.ready = 'yes';

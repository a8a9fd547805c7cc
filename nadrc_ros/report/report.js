// Fills the plots of a report, and shows the same stretch of time and the same moment in all.
'use strict';

const PAPER = 1000; // px: the width of a printed plot, whatever the window
const plots = [];
let timed = []; // those over time
const hidden = { run: new Set(), column: new Set(['measurement']) };
const find = (query) => document.querySelector(query);
const every = (query) => [...document.querySelectorAll(query)];

// ---- plots ----

function visible([run, column]) {
  return !hidden.run.has(run) && !hidden.column.has(column);
}

function fill(plot) {
  for (const each of plot.lines) each.visible = visible(each.tags);
  if (!plot.over_time) return;
  plot.model.x_range.setv({ start: shown.from, end: shown.to });
  const width = plot.view?.frame.bbox.width || plot.element.clientWidth;
  for (const each of plot.lines) {
    if (each.visible) each.data_source.data = line(each.tags, width);
  }
  if (find('#scale').value === 'fixed' && plot.scaled) return;
  const found = range(plot.lines.map((each) => each.tags).filter(visible), find('#scale').value === 'all');
  if (!found) return;
  plot.scaled = true;
  plot.model.y_range.setv({ start: found.low, end: found.high });
  plot.outside.textContent = found.cut
    ? `Cut off: the values go from ${brief(found.full[0])} to ${brief(found.full[1])}.` : '';
}

/** Make a plot, once. */
function make(plot) {
  plot.made ??= (async () => {
    const whole = Bokeh.require('document').Document.from_json(plot.described);
    const models = [...whole._all_models?.values() ?? whole.all_models];
    models.forEach(remember);
    [plot.model] = whole.roots();
    plot.lines = plot.model.renderers.filter(({ tags }) => tags?.length);
    plot.marks = models.filter(({ tags }) => tags?.[0] === 'of');
    fill(plot);
    const views = await Bokeh.embed.add_document_standalone(whole, document.body, [plot.element]);
    plot.view = views.get(plot.model);
    if (!plot.over_time) return;
    for (const name of ['cursor', 'chosen']) {
      plot[name] = plot.element.appendChild(document.createElement('div'));
      plot[name].className = name;
      plot[name].hidden = true;
    }
    timed = plots.filter(({ over_time, view }) => over_time && view);
    listen(plot);
    plot.model.properties.inner_width.change.connect(draw_cursor);
    fill(plot); // what was done meanwhile
    draw_cursor();
  })();
  return plot.made;
}

function draw(plot) {
  plot.model.hold_render = false;
  fill(plot);
}

const idle = window.requestIdleCallback ?? setTimeout; // Safari

/** Draw a plot, now if it is in sight, others when there is time. */
function refresh(plot) {
  if (!plot.view) return;
  if (plot.near) { draw(plot); return; }
  plot.model.hold_render = true;
  if (plot.waits) return;
  plot.waits = true;
  idle(() => { plot.waits = false; draw(plot); });
}

const sight = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    const plot = plots.find(({ element }) => element === target);
    plot.near = isIntersecting;
    if (plot.near) make(plot);
    if (plot.near && plot.waits) draw(plot);
  }
}, { rootMargin: '300px' });

function show(from, to) {
  const least = 1e-9 * (span[1] - span[0]);
  if (!(to - from > least)) return;
  [shown.from, shown.to] = [from, to];
  timed.forEach(refresh);
  draw_cursor();
}

function zoom(factor, at = 0.5) {
  const wide = shown.to - shown.from;
  const from = shown.from + at * wide * (1 - factor);
  show(Math.max(span[0], from), Math.min(span[1], from + factor * wide));
}

function move(share) {
  const wide = shown.to - shown.from;
  const from = Math.min(Math.max(shown.from + share * wide, span[0]), span[1] - wide);
  show(from, from + wide);
}

// ---- cursor ----

function text(value) {
  if (!Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  if (size && (size < 1e-3 || size >= 1e7)) return value.toExponential(2).replace(/-/g, '−');
  const digits = 3 - Math.floor(Math.log10(size || 1));
  return value.toFixed(Math.min(Math.max(digits, 0), 5)).replace('-', '−');
}

const brief = (value) => String(Number(value.toPrecision(3))).replace('-', '−');

/** The row of a run that is nearest to a time. */
function nearest(run, at) {
  const { time } = run.columns;
  const after = Math.min(place(time, at), time.length - 1);
  return after && at - time[after - 1] < time[after] - at ? after - 1 : after;
}

function draw_cursor() {
  const at = shown.moment;
  for (const plot of timed) {
    const box = plot.view.frame.bbox;
    const share = (at - shown.from) / (shown.to - shown.from);
    plot.cursor.hidden = at === null || share < 0 || share > 1;
    const [left, top, height] = [box.left + share * box.width, box.top, box.height];
    Object.assign(plot.cursor.style, { left: `${left}px`, top: `${top}px`, height: `${height}px` });
  }
  find('#moment').textContent = at === null ? 't = –' : `t = ${at.toFixed(decimals())} s`;
  for (const row of every('#values tbody tr')) {
    const run = runs[row.dataset.run];
    const { time } = run.columns;
    const inside = at !== null && at >= time[0] - 1e-9 && at <= time[time.length - 1] + 1e-9;
    const i = inside ? nearest(run, at) : -1;
    for (const cell of row.querySelectorAll('[data-column]')) {
      const values = run.columns[cell.dataset.column];
      cell.textContent = values && i >= 0 ? text(values[i]) : '–';
    }
  }
  find('#gap').textContent = at === null ? '' : runs.flatMap(({ name, gaps, states }) => {
    const now = ([begin, end]) => begin <= at && at < end;
    const said = states.filter(now).map(([, , state, cause]) => `${state} (${cause})`);
    said.push(...gaps.filter(now).map(([, , cause]) => cause));
    return said.map((each) => (runs.length > 1 ? `${name}: ${each}` : each));
  }).join('; ');
}

/** As many decimals of time as tell rows apart. */
function decimals() {
  const { time } = runs[shown.run].columns;
  const usual = (time[time.length - 1] - time[0]) / Math.max(1, time.length - 1) || 1;
  return Math.max(0, Math.min(9, Math.ceil(0.5 - Math.log10(usual))));
}

function point(at) {
  const run = runs[shown.run];
  shown.moment = at === null ? null : run.columns.time[nearest(run, at)];
  draw_cursor();
}

function step(count) {
  const { time } = runs[shown.run].columns;
  const now = shown.moment === null ? place(time, shown.from) : nearest(runs[shown.run], shown.moment);
  const i = Math.min(Math.max(now + count, 0), time.length - 1);
  const wide = shown.to - shown.from;
  if (time[i] < shown.from || time[i] > shown.to) show(time[i] - wide / 2, time[i] + wide / 2);
  point(time[i]);
}

// ---- pointer and keys ----

function listen(plot) {
  const time = (event) => {
    const box = plot.view.frame.bbox;
    const x = event.clientX - plot.element.getBoundingClientRect().left - box.left;
    return shown.from + Math.min(1, Math.max(0, x / box.width)) * (shown.to - shown.from);
  };
  let begin = null;
  plot.element.addEventListener('pointerdown', (event) => {
    if (event.pointerType === 'touch') { point(time(event)); return; }
    if (event.button) return;
    begin = { x: event.clientX, time: time(event) };
    plot.element.setPointerCapture(event.pointerId);
  });
  plot.element.addEventListener('pointermove', (event) => {
    point(time(event));
    if (!begin) return;
    const left = plot.element.getBoundingClientRect().left;
    const [a, b] = [begin.x, event.clientX].sort((one, two) => one - two);
    plot.chosen.hidden = b - a < 4;
    plot.chosen.style.left = `${a - left}px`;
    plot.chosen.style.width = `${b - a}px`;
  });
  plot.element.addEventListener('pointerup', (event) => {
    if (begin && Math.abs(event.clientX - begin.x) >= 4) {
      show(...[begin.time, time(event)].sort((one, two) => one - two));
    }
    begin = null;
    plot.chosen.hidden = true;
  });
  plot.element.addEventListener('pointercancel', () => { begin = null; plot.chosen.hidden = true; });
  plot.element.addEventListener('pointerleave', (event) => {
    if (!begin && event.pointerType === 'mouse') point(null);
  });
  plot.element.addEventListener('dblclick', () => show(...span));
  plot.element.addEventListener('wheel', (event) => {
    if (!(event.ctrlKey || event.shiftKey)) return; // the page scrolls
    event.preventDefault();
    const at = (time(event) - shown.from) / (shown.to - shown.from);
    zoom((event.deltaY || event.deltaX) > 0 ? 1.25 : 0.8, at);
  }, { passive: false });
}

const ACTIONS = {
  in: () => zoom(0.5), out: () => zoom(2), back: () => move(-0.25), on: () => move(0.25),
  all: () => show(...span),
};
const KEYS = {
  ArrowLeft: ACTIONS.back, ArrowRight: ACTIONS.on, '+': ACTIONS.in, '=': ACTIONS.in,
  '-': ACTIONS.out, 0: ACTIONS.all, Home: ACTIONS.all, ',': () => step(-1), '.': () => step(1),
  Escape: () => point(null),
  y: () => {
    const scale = find('#scale');
    scale.selectedIndex = (scale.selectedIndex + 1) % scale.length;
    timed.forEach(refresh);
  },
};

function toggle(button) {
  const [kind, value] = button.dataset.run ? ['run', Number(button.dataset.run)]
    : ['column', button.dataset.column];
  const on = hidden[kind].delete(value);
  if (!on) hidden[kind].add(value);
  button.setAttribute('aria-pressed', on);
  plots.forEach(refresh);
}

/** Let one run stand out while the pointer or the focus is on its name. */
function single_out(run) {
  for (const { lines, marks, view } of plots) {
    if (!view) continue;
    for (const { glyph, tags } of lines) {
      if ('line_alpha' in glyph) glyph.line_alpha = run === null || tags[0] === run ? 1 : 0.15;
    }
    for (const mark of marks) mark.visible = mark.tags.includes(run);
  }
}

// ---- light, dark, paper ----

const coloured = [];

function paint(night, properties = coloured) {
  for (const { property, light } of properties) {
    property.obj[property.attr] = night ? dark[light] : light;
  }
}

function remember(model) {
  const found = [];
  for (const property of model) {
    const value = property.is_unset ? null : property.get_value();
    const colour = value && typeof value === 'object' && 'value' in value ? value.value : value;
    if (typeof colour === 'string' && colour in dark) found.push({ property, light: colour });
  }
  coloured.push(...found);
  if (night.matches) paint(true, found);
}

const night = matchMedia('(prefers-color-scheme: dark)');

function print_images() {
  const legend = find('#legend');
  const { open } = legend;
  legend.open = true;
  addEventListener('afterprint', () => { legend.open = open; }, { once: true });
  paint(false);
  for (const { view, element } of plots.filter((plot) => plot.view)) {
    const image = element.querySelector('.printed') || element.appendChild(new Image());
    image.className = 'printed';
    image.alt = element.getAttribute('aria-label');
    element.style.width = `${PAPER}px`;
    view.after_resize();
    for (const each of view.renderer_views.values()) { // Bokeh itself does this later, too late
      each.glyph?.set_visuals(each.model.data_source, each.all_indices);
    }
    image.src = view.export('png', true).canvas.toDataURL();
    element.style.width = '';
    view.after_resize();
  }
  paint(night.matches);
}

// ---- start ----

async function start() {
  const [bokeh, data, samples] = await Promise.all(['bokeh', 'data', 'samples'].map(unpacked));
  const told = JSON.parse(new TextDecoder().decode(data));
  ({ runs, span, dark } = told);
  const columns = columns_of(told.columns, samples);
  for (const run of runs) {
    for (const [name, at] of Object.entries(run.columns)) run.columns[name] = columns[at];
  }
  [shown.from, shown.to] = span;
  const script = document.createElement('script');
  script.textContent = new TextDecoder().decode(bokeh);
  document.head.append(script);
  Bokeh.logger.set_level('error');
  told.plots.forEach((described, i) => {
    const element = find(`#plot-${i} .canvas`);
    plots.push({ described, over_time: told.timed[i], element, outside: find(`#plot-${i} .outside`) });
  });
  every('[data-do]').forEach((button) => button.addEventListener('click', ACTIONS[button.dataset.do]));
  every('.toggle').forEach((button) => button.addEventListener('click', () => toggle(button)));
  every('#values tbody tr').forEach((row) => {
    const run = Number(row.dataset.run);
    for (const [on, off] of [['pointerenter', 'pointerleave'], ['focusin', 'focusout']]) {
      row.addEventListener(on, () => { shown.run = run; single_out(run); });
      row.addEventListener(off, () => single_out(null));
    }
  });
  find('#scale').addEventListener('change', () => timed.forEach(refresh));
  addEventListener('keydown', (event) => {
    if (event.target.matches('select, input') || event.ctrlKey || event.metaKey || event.altKey) return;
    const act = KEYS[event.key];
    if (act) { act(); event.preventDefault(); }
  });
  if (matchMedia('(max-width: 60rem)').matches) find('#legend').open = false;
  night.addEventListener('change', () => paint(night.matches));
  addEventListener('beforeprint', print_images);
  for (const plot of plots) sight.observe(plot.element); // makes those in sight at once
  for (const plot of plots) {
    await new Promise((done) => setTimeout(done)); // the page answers meanwhile
    await make(plot);
  }
  document.documentElement.dataset.ready = 'yes';
}

start().catch((error) => {
  find('#broken').hidden = false;
  throw error;
});

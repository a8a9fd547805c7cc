// Elements and texts. What comes from the graph is always text, never markup.

export const find = (query) => document.querySelector(query);
export const every = (query, root = document) => [...root.querySelectorAll(query)];

/** An element with properties, attributes (with a dash or `role`), listeners (on...) and children. */
export function make(tag, given = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(given)) {
    if (name.startsWith('on')) element.addEventListener(name.slice(2), value);
    else if (name.startsWith('data-')) element.setAttribute(name, value);
    else if (/^(aria-|role$|for$|scope$)/.test(name)) element.setAttribute(name, value);
    else element[name] = value;
  }
  element.append(...children.filter((each) => each !== null && each !== undefined));
  return element;
}

/** Set a text only where it changes: a screen reader would say it again. */
export function tell(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** A number as it is read: four digits, a real minus. */
export function brief(value, digits = 4) {
  if (typeof value !== 'number' || !Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  if (size && (size < 1e-4 || size >= 1e7)) {
    return String(Number(value.toPrecision(digits)).toExponential()).replace(/-/g, '−').replace('e+', 'e');
  }
  return String(Number(value.toPrecision(digits))).replace('-', '−');
}

/** A number of constant width of its fraction, for what changes all the time. */
export function steady(value) {
  if (typeof value !== 'number' || !Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  if (size && (size < 1e-3 || size >= 1e6)) return value.toExponential(2).replace(/-/g, '−');
  const digits = 3 - Math.floor(Math.log10(Math.max(size, 1)));
  return value.toFixed(Math.max(digits, 0)).replace('-', '−');
}

/** Any value of a parameter, as it is typed. */
export function typed(value) {
  if (Array.isArray(value)) return value.join(', ');
  return String(value ?? '');
}

/** Show a value in a field, unless somebody is typing there: until Enter, Esc or another field. */
export function show_value(field, value) {
  if (!field.typing) field.value = typed(value);
}

/** Note when somebody types in a field. */
export function mind_typing(field, current) {
  field.addEventListener('input', () => { field.typing = true; });
  field.addEventListener('change', () => { field.typing = false; }, { capture: true });
  field.addEventListener('keydown', ({ key }) => {
    if (key !== 'Escape') return;
    field.typing = false;
    show_value(field, current());
  });
  return field;
}

/** Let a screen reader say something once. */
export function say(text) {
  find('#spoken').textContent = text;
}

export function download(name, content) {
  const link = make('a', { href: URL.createObjectURL(content), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** A name for a file of what is seen now. */
export function stamped(what, ending) {
  const now = new Date().toISOString().slice(0, 19).replace(/[T:]/g, '-');
  return `nadrc-${what}-${now}.${ending}`;
}

let opener = null;

/** Show something over the page, which stays as it is: STOP can be pressed meanwhile. */
export function show_dialog(title, ...content) {
  opener = document.activeElement;
  find('#dialog-title').textContent = title;
  find('#dialog-body').replaceChildren(...content.filter(Boolean));
  find('#dialog').show();
  find('#dialog-title').focus();
}

/** Close what is shown over the page; false if nothing is. */
export function close_dialog() {
  if (!find('#dialog').open) return false;
  find('#dialog').close();
  opener?.focus();
  return true;
}

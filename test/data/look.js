// Looks at a page of `nadrc report` from inside, and returns what it sees.
'use strict';

function luminance(colour) {
  const parts = colour.match(/[\d.]+/g).slice(0, 3).map((part) => part / 255);
  const linear = parts.map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
  return linear[0] * 0.2126 + linear[1] * 0.7152 + linear[2] * 0.0722;
}
function behind(element) {
  for (let one = element; one; one = one.parentElement) {
    const colour = getComputedStyle(one).backgroundColor;
    if (!/, 0\)$/.test(colour)) return colour;
  }
  return 'rgb(255, 255, 255)';
}
function contrast(element) {
  const [low, high] = [getComputedStyle(element).color, behind(element)].map(luminance).sort((a, b) => a - b);
  return (high + 0.05) / (low + 0.05);
}
function covered(element) {
  element.scrollIntoView({ block: 'end' }); // below the legend, which may fill more than half
  const box = element.getBoundingClientRect();
  if (!box.width || !box.height) return false;
  const top = document.elementFromPoint(
    Math.min(Math.max(box.left, 0) + Math.min(box.width, innerWidth) / 2, innerWidth - 1),
    box.top + box.height / 2);
  return !(element.contains(top) || (top && top.contains(element) && top.closest('main')));
}
async function look() {
  const found = {};
  found.width = innerWidth;
  found.overflow = document.documentElement.scrollWidth - innerWidth;
  show(1.0, 1.5);
  timed.forEach(fill); // those out of sight wait
  point(1.2345);
  found.moment = find('#moment').textContent;
  found.values = Object.fromEntries(every('#values [data-column]').map(
    (cell) => [cell.dataset.column, cell.textContent]));
  found.lines = timed.flatMap((plot) => plot.lines.filter((each) => each.visible).map((each) => [
    each.tags[1], [...each.data_source.data.x], [...each.data_source.data.y]]));
  found.axes = timed.map(({ model }) => [model.x_range.start, model.x_range.end]);
  const { y_range } = timed[0].model;
  found.output_axis = [y_range.start, y_range.end];
  find('[data-do=all]').click();
  found.all = [shown.from, shown.to];
  document.body.dispatchEvent(new KeyboardEvent('keydown', { key: '+', bubbles: true }));
  found.keyed = shown.to - shown.from;
  find('[data-column=reference].toggle').click();
  timed.forEach(fill);
  found.hidden = timed[0].lines.filter((each) => each.tags[1] === 'reference' && !each.visible).length;
  print_images();
  const printed = every('.printed');
  await Promise.all(printed.map((each) => each.decode()));
  found.printed = printed.map((each) => each.naturalWidth / devicePixelRatio);
  found.dark = timed[0].model.background_fill_color;
  every('details').forEach((each) => { each.open = true; });
  const own = (each) => [...each.childNodes].some((node) => node.nodeType === 3 && node.data.trim());
  const texts = every('main *').filter((each) => own(each) && each.checkVisibility());
  found.texts = texts.length;
  found.faint = texts.filter((each) => contrast(each) < 4.5).map((each) => each.outerHTML.slice(0, 90));
  found.covered = [...texts, ...every('.canvas')].filter(covered).map((each) => each.outerHTML.slice(0, 90));
  return found;
}

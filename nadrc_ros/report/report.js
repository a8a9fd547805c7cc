// Draws the plots of a report. All plots over time show the same stretch of it.
'use strict';

const CONFIG = {
  responsive: true,
  displaylogo: false,
  showSendToCloud: false, // nothing leaves the machine
  plotlyServerURL: '',
  modeBarButtonsToRemove: ['select2d', 'lasso2d', 'autoScale2d'],
};
const PRINTED = 680; // px: the width of A4 between its margins
const timed = [];
let following = false;

function draw(box) {
  const figure = JSON.parse(box.querySelector('script').textContent);
  box.textContent = '';
  if (matchMedia('(pointer: coarse)').matches) figure.layout.dragmode = false; // a finger scrolls
  Plotly.newPlot(box, figure.data, figure.layout, CONFIG);
  if (box.dataset.timed) {
    timed.push(box);
    box.on('plotly_relayout', (change) => follow(box, change));
  }
}

function follow(source, change) {
  const range = source.layout.xaxis.range;
  if (following || !Object.keys(change).some((key) => key.startsWith('xaxis.'))) return;
  following = true;
  const others = timed.filter((box) => box !== source);
  const moves = others.map((box) => Plotly.relayout(box, { 'xaxis.range': [...range] }));
  Promise.all(moves).finally(() => { following = false; });
}

const boxes = [...document.querySelectorAll('.plot')];
boxes.forEach(draw);
addEventListener('beforeprint', () => {
  document.querySelectorAll('details').forEach((each) => { each.open = true; });
  boxes.forEach((box) => Plotly.relayout(box, { width: PRINTED }));
});
addEventListener('afterprint', () => {
  boxes.forEach((box) => Plotly.relayout(box, { width: null, autosize: true }));
});

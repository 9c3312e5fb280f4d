// Draws the plots of a page, with as many panels beside each other as there is room for.
"use strict";
// Heights of what is around a panel, and what is between two of them [px].
const LEGEND = 26, TITLE = 24, LABEL = 22, TICKS = 30, GAP = 64, SIDES = 56 + 12;
// Least widths of a panel, and the width of a page of A4 within its margins [px].
const NARROWEST = 300, NARROWEST_IN_PRINT = 220, PRINTED = 680;
const TOUCH = matchMedia("(pointer: coarse)").matches;
const SMALL = TOUCH || innerWidth <= 640;
const CONFIG = { displaylogo: false, displayModeBar: SMALL ? false : "hover" };
const nameOf = (axis, k) => axis + (k ? k + 1 : "");

// Where every panel goes: a figure's `meta` says how many there are, and in how many columns.
const arranged = ({ meta, showlegend, scene }, width, narrowest = NARROWEST) => {
  if (scene) return { width, height: Math.max(320, Math.min(640, 0.8 * width)) };
  if (!meta) return { width };
  const columns = width >= meta.columns * narrowest ? meta.columns : 1;
  const inner = width - SIDES, pitch = (inner + GAP) / columns, tall = meta.panels / meta.columns;
  // Panels are counted along rows; one below the other they come column by column.
  const order = [...Array(meta.panels).keys()];
  if (columns < meta.columns && meta.headed) {
    const place = (k) => (k % meta.columns) * tall + Math.floor(k / meta.columns);
    order.sort((a, b) => place(a) - place(b));
  }
  const tops = [];
  let top = showlegend ? LEGEND : 0;
  for (let first = 0; first < order.length; first += columns) {
    const inRow = order.slice(first, first + columns);
    top += LABEL + (inRow.some((k) => k < meta.headed) ? TITLE : 0);
    for (const k of inRow) tops[k] = top;
    top += meta.height + TICKS;
  }
  const layout = { width, height: top };
  order.forEach((k, place) => {
    const left = (place % columns) * pitch;
    layout[`${nameOf("xaxis", k)}.domain`] = [left / inner, (left + pitch - GAP) / inner];
    layout[`${nameOf("yaxis", k)}.domain`] = [1 - (tops[k] + meta.height) / top, 1 - tops[k] / top];
  });
  return layout;
};

const draw = async (place) => {
  if (place.dataset.drawn || place.closest("details:not([open])")) return;
  place.dataset.drawn = "yes";
  const figure = JSON.parse(document.getElementById(place.dataset.figure).textContent);
  const { layout } = figure;
  if (TOUCH && layout.meta) layout.dragmode = false; // a finger on a plot moves the page
  place.meta = layout.meta;
  const all = arranged(layout, place.clientWidth);
  for (const [path, value] of Object.entries(all)) {
    const [name, part] = path.split(".");
    if (part) layout[name][part] = value;
    else layout[name] = value;
  }
  place.widthDrawn = place.clientWidth;
  await Plotly.newPlot(place, { ...figure, config: CONFIG });
  place.dispatchEvent(new CustomEvent("drawn", { bubbles: true, detail: figure }));
};

const fit = (place, width, narrowest) => {
  if (!place.dataset.drawn || !width || place.widthDrawn === width) return;
  place.widthDrawn = width;
  Plotly.relayout(place, arranged({ ...place._fullLayout, meta: place.meta }, width, narrowest));
};

// A plan's plots are drawn when it is opened: two hundred plans at once are more than a browser
// bears. One comes after the other, so that the page can be moved meanwhile.
const places = document.querySelectorAll(".plot");
const drawAll = async (part) => {
  for (const place of part.querySelectorAll(".plot")) {
    await draw(place);
    await new Promise((done) => setTimeout(done));
  }
};
const sized = new ResizeObserver((entries) => {
  for (const { target } of entries) fit(target, target.clientWidth);
});
for (const place of places) sized.observe(place);
for (const part of document.querySelectorAll("details")) {
  part.addEventListener("toggle", () => drawAll(part));
}

const openTarget = () => {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (target instanceof HTMLDetailsElement) { target.open = true; target.scrollIntoView(); }
};
window.addEventListener("hashchange", openTarget);
window.addEventListener("beforeprint", () => {
  for (const place of places) fit(place, PRINTED, NARROWEST_IN_PRINT);
});
window.addEventListener("afterprint", () => {
  for (const place of places) fit(place, place.clientWidth);
});
openTarget();

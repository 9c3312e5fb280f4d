// Pictures of a study, from the page's own table: what became of its cases over what was varied.
const MOST_VALUES = 16, FEWEST_BINS = 3, MOST_BINS = 12, LISTED = 12;
// Okabe and Ito's, which colour-blind readers tell apart; what is solved is blue, darker for more.
const CURVES = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"];
const CAUSES = ["#d55e00", "#e69f00", "#cc79a7", "#000000", "#f0e442", "#009e73", "#999999"];
const DASHES = ["solid", "dash", "dot", "dashdot"];
const COSTS = [[0, "#e3eefa"], [0.5, "#6baed6"], [1, "#08306b"]], ALL_SOLVED = "#e3eefa";
const SHOWN = { displaylogo: false, responsive: true, displayModeBar: false };
const SOLVED = "solved", CAUSE = "cause";

const plain = (words) => String(words).replace(/&/g, "&amp;").replace(/</g, "&lt;");
const short = (value) => String(Number(value.toPrecision(4)));
const sorted = (values) => Float64Array.from(values).sort();
const quantile = (ordered, share) => {
  const place = share * (ordered.length - 1), below = Math.floor(place);
  const above = Math.min(below + 1, ordered.length - 1);
  return ordered[below] + (place - below) * (ordered[above] - ordered[below]);
};

// The interval of Clopper and Pearson: at its ends, what was seen or more is as rare as 2.5 %.
const exactInterval = (count, total) => {
  const log = [0];
  for (let k = 1; k <= total; k++) log.push(log[k - 1] + Math.log(k));
  const atLeast = (least, p) => {
    let sum = 0;
    for (let k = least; k <= total; k++) {
      sum += Math.exp(log[total] - log[k] - log[total - k] + k * Math.log(p) + (total - k) * Math.log1p(-p));
    }
    return sum;
  };
  const root = (least, wanted) => {
    let [low, high] = [0, 1];
    for (let k = 0; k < 50; k++) {
      const middle = (low + high) / 2;
      if (atLeast(least, middle) < wanted) low = middle;
      else high = middle;
    }
    return (low + high) / 2;
  };
  return [count ? root(count, 0.025) : 0, count < total ? root(count + 1, 0.975) : 1];
};

// The places of a quantity on an axis: its values where these are few or words, else equal parts.
const axisOf = ({ values, labels }, cases) => {
  const known = cases.map((k) => values[k]).filter((value) => value !== null);
  const different = [...new Set(known)].sort((a, b) => a - b), places = new Map();
  different.forEach((value, place) => places.set(value, place));
  if (labels || different.length <= MOST_VALUES) {
    const at = labels ? different.map((_, place) => place) : different, end = at.length - 1;
    const between = at.slice(1).map((value, k) => (value + at[k]) / 2);
    const aside = end ? [at[1] - at[0], at[end] - at[end - 1]] : [1, 1];
    const edges = [at[0] - aside[0] / 2, ...between, at[end] + aside[1] / 2];
    const words = different.map((value) => (labels ? plain(labels[value]) : short(value)));
    return { edges, middles: at, words, of: (k) => places.get(values[k]), ticks: { tickvals: at, ticktext: words } };
  }
  const count = Math.max(FEWEST_BINS, Math.min(MOST_BINS, Math.round(Math.sqrt(known.length) / 2)));
  const low = different[0], width = (different[different.length - 1] - low) / count;
  const edges = [...Array(count + 1).keys()].map((k) => low + k * width);
  const words = edges.slice(1).map((edge, k) => `${short(edges[k])} to ${short(edge)}`);
  const middles = edges.slice(1).map((edge, k) => (edge + edges[k]) / 2);
  const of = (k) => (values[k] === null ? undefined : Math.min(count - 1, Math.floor((values[k] - low) / width)));
  return { edges, middles, words, of, ticks: {} };
};

const option = (words, value) => new Option(words, value);
const choice = (label, options, chosen) => {
  const made = document.createElement("label"), select = document.createElement("select");
  select.append(...options);
  select.value = chosen;
  made.append(`${label} `, select);
  return { made, select };
};
const layoutOf = (across, up, more) => ({
  height: 380, margin: { l: 70, r: 10, t: 30, b: 60 }, template: "none", hovermode: "closest",
  xaxis: { title: { text: across }, zeroline: false, automargin: true },
  yaxis: { title: { text: up }, zeroline: false, automargin: true },
  legend: { orientation: "h", y: 1.02, yanchor: "bottom" }, ...more,
});

const explore = (place) => {
  const told = JSON.parse(document.getElementById(place.dataset.cases).textContent);
  const { quantities, metrics, methods, statuses } = told;
  const all = [...told.ids.keys()], filters = [];
  const isSolved = (k) => told.solved[k];
  const part = (name) => place.querySelector(`.${name}`);
  const kept = (cases) => filters.reduce((left, { column, select }) => (
    select.value === "" ? left : left.filter((k) => String(column.values[k]) === select.value)), cases);
  const ofMethod = (cases, method) => cases.filter((k) => methods.values[k] === method);
  const metricOptions = () => metrics.map(({ name }, k) => option(name, k));
  const shownOptions = () => [option("solved [%]", SOLVED), option("causes of refusal", CAUSE), ...metricOptions()];
  const named = (value) => (value === SOLVED ? "solved [%]" : metrics[value].name);
  const median = (cases, metric) => {
    const values = cases.filter(isSolved).map((k) => metric.values[k]).filter((value) => value !== null);
    return values.length ? quantile(sorted(values), 0.5) : null;
  };
  // The status that refused most of some cases; undefined: none was refused.
  const causeOf = (cases) => {
    const counts = new Map();
    for (const k of cases) if (!isSolved(k)) counts.set(told.status[k], (counts.get(told.status[k]) || 0) + 1);
    return [...counts].sort((a, b) => b[1] - a[1] || a[0] - b[0]);
  };
  const colourOf = (status) => CAUSES[status % CAUSES.length];

  // The cases of a cell: one whose plan has a page is opened, and all are listed.
  const list = (cases) => {
    const box = part("cases"), [only] = cases;
    if (cases.length === 1 && told.pages[told.ids[only]]) window.open(told.pages[told.ids[only]]);
    const table = document.createElement("table"), head = table.createTHead().insertRow();
    const columns = [...quantities, ...metrics.slice(0, 6)];
    for (const name of ["case", "method", "status", ...columns.map((one) => one.name)]) {
      head.append(Object.assign(document.createElement("th"), { textContent: name }));
    }
    const body = table.createTBody();
    for (const k of cases.slice(0, LISTED)) {
      const row = body.insertRow(), id = told.ids[k], page = told.pages[id];
      if (page) row.insertCell().append(Object.assign(document.createElement("a"), { href: page, textContent: id, target: "_blank" }));
      else row.insertCell().textContent = id;
      row.insertCell().textContent = methods.labels[methods.values[k]];
      row.insertCell().textContent = statuses[told.status[k]].words;
      for (const { values, labels } of columns) {
        const value = values[k];
        row.insertCell().textContent = value === null ? "-" : labels ? labels[value] : short(value);
      }
    }
    const words = document.createElement("p");
    const more = cases.length > LISTED ? ` The first ${LISTED} of ${cases.length}.` : "";
    const without = cases.find((k) => !told.pages[told.ids[k]]);
    words.textContent = `${cases.length} in this cell.${more}`;
    if (without !== undefined) words.textContent += ` A page of one without a link: ${told.command}${told.ids[without]}`;
    box.replaceChildren(words, table);
  };

  const drawMap = (where, across, up, shown, cases) => {
    const x = axisOf(quantities[across], cases), y = axisOf(quantities[up], cases);
    const cells = y.words.map(() => x.words.map(() => []));
    for (const k of cases) {
      const [column, row] = [x.of(k), y.of(k)];
      if (column !== undefined && row !== undefined) cells[row][column].push(k);
    }
    const each = (value, empty = null) => cells.map((row, j) => row.map((cell, i) => (cell.length ? value(cell, j, i) : empty)));
    const hovertext = each((cell, j, i) => {
      const count = cell.filter(isSolved).length, lines = [];
      lines.push(`${plain(quantities[across].name)}: ${x.words[i]}`, `${plain(quantities[up].name)}: ${y.words[j]}`);
      lines.push(cell.length === 1 ? "1 case" : `${cell.length} cases: ${count} solved`);
      for (const [status, n] of causeOf(cell)) lines.push(`${n} ${plain(statuses[status].words)}`);
      if (count && shown !== SOLVED && shown !== CAUSE) lines.push(`${plain(named(shown))}: ${short(median(cell, metrics[shown]) ?? NaN)}`);
      return lines.join("<br>");
    });
    const common = { type: "heatmap", x: x.edges, y: y.edges, hovertext, hoverinfo: "text", hoverongaps: false, xgap: 1, ygap: 1 };
    const bar = { thickness: 12, title: { text: shown === CAUSE ? "" : plain(named(shown)), side: "right" } };
    const traces = [];
    if (shown === SOLVED) {
      const z = each((cell) => (100 * cell.filter(isSolved).length) / cell.length);
      const text = each((cell) => `${cell.filter(isSolved).length}/${cell.length}`, "");
      traces.push({ ...common, z, text, texttemplate: "%{text}", zmin: 0, zmax: 100, colorscale: "Cividis", colorbar: bar });
    } else {
      const z = each((cell) => (shown === CAUSE ? (cell.every(isSolved) ? 1 : null) : median(cell, metrics[shown])));
      const scale = shown === CAUSE ? [[0, ALL_SOLVED], [1, ALL_SOLVED]] : COSTS;
      traces.push({ ...common, z, colorscale: scale, showscale: shown !== CAUSE, colorbar: bar });
      const refused = each((cell) => (shown === CAUSE || !cell.some(isSolved) ? causeOf(cell)[0]?.[0] ?? null : null));
      const steps = statuses.flatMap((_, k) => [k, k + 1].map((edge) => [edge / statuses.length, colourOf(k)]));
      traces.push({
        ...common, z: refused, zmin: -0.5, zmax: statuses.length - 0.5, colorscale: steps, showscale: false,
        text: refused.map((row) => row.map((status) => (status === null ? "" : statuses[status].code))), texttemplate: "%{text}",
      });
      for (const status of new Set(refused.flat().filter((status) => status !== null))) {
        const marker = { symbol: "square", size: 12, color: colourOf(status) };
        traces.push({ type: "scatter", mode: "markers", x: [null], y: [null], marker, name: plain(statuses[status].words), showlegend: true });
      }
    }
    const layout = layoutOf(plain(quantities[across].name), plain(quantities[up].name));
    Object.assign(layout.xaxis, x.ticks);
    Object.assign(layout.yaxis, y.ticks);
    Plotly.react(where, traces, layout, SHOWN);
    where.removeAllListeners?.("plotly_click");
    where.on("plotly_click", ({ points: [point] }) => list(cells[point.pointIndex[0]][point.pointIndex[1]]));
  };

  const drawCurve = (where, across, shown, cases) => {
    const axis = axisOf(quantities[across], cases), traces = [];
    methods.labels.forEach((name, method) => {
      const parts = axis.words.map(() => []);
      for (const k of ofMethod(cases, method)) if (axis.of(k) !== undefined) parts[axis.of(k)].push(k);
      const x = [], y = [], above = [], below = [];
      parts.forEach((cell, i) => {
        const values = sorted(shown === SOLVED ? [] : cell.filter(isSolved).map((k) => metrics[shown].values[k]).filter((v) => v !== null));
        if (shown === SOLVED ? !cell.length : !values.length) return;
        const count = cell.filter(isSolved).length;
        const middle = shown === SOLVED ? (100 * count) / cell.length : quantile(values, 0.5);
        const [low, high] = shown !== SOLVED ? [quantile(values, 0.05), quantile(values, 0.95)]
          : told.drawn ? exactInterval(count, cell.length).map((end) => 100 * end) : [middle, middle];
        x.push(axis.middles[i]); y.push(middle); above.push(high - middle); below.push(middle - low);
      });
      const line = { color: CURVES[method % CURVES.length], dash: DASHES[method % DASHES.length] };
      const bars = { type: "data", symmetric: false, array: above, arrayminus: below, thickness: 1 };
      traces.push({ type: "scatter", mode: "lines+markers", x, y, name: plain(name), line, error_y: bars, showlegend: true });
    });
    const range = shown === SOLVED ? { range: [-4, 104] } : {};
    const layout = layoutOf(plain(quantities[across].name), plain(named(shown)));
    Object.assign(layout.xaxis, axis.ticks);
    Object.assign(layout.yaxis, range);
    Plotly.react(where, traces, layout, SHOWN);
  };

  const drawShares = (where, shown, cases) => {
    const { name, values, of_all: ofAll } = metrics[shown];
    const traces = methods.labels.map((label, method) => {
      const found = sorted(ofMethod(cases, method).filter((k) => ofAll || isSolved(k)).map((k) => values[k]).filter((v) => v !== null));
      const y = [...found].map((_, k) => (100 * (k + 1)) / found.length);
      const line = { shape: "hv", color: CURVES[method % CURVES.length], dash: DASHES[method % DASHES.length] };
      return { type: "scatter", mode: "lines", x: [...found], y, name: plain(label), line, showlegend: true };
    });
    // Times differ by powers of ten; a linear axis shows the slowest alone.
    const scale = ofAll ? { type: "log" } : {};
    const whose = ofAll ? "of all cases [%]" : "of solved cases [%]";
    const layout = layoutOf(plain(name), whose, { hovermode: "x" });
    Object.assign(layout.xaxis, scale);
    Plotly.react(where, traces, layout, SHOWN);
  };

  // The choices, and what is drawn by them.
  const pictures = [], draw = () => { for (const picture of pictures) picture(); };
  const choose = (box, label, options, chosen) => {
    const { made, select } = choice(label, options, chosen);
    select.addEventListener("change", draw);
    part(box).append(made);
    return select;
  };
  const quantityOptions = () => quantities.map(({ name }, k) => option(name, k));
  for (const column of [told.sources, ...quantities]) {
    const different = [...new Set(column.values)].filter((v) => v !== null).sort((a, b) => a - b);
    if (different.length < 2 || different.length > MOST_VALUES) continue;
    const options = different.map((value) => option(column.labels ? column.labels[value] : short(value), String(value)));
    const others = told.chosen.others[column.name];
    const select = choose("filters", column.name, [option("all", ""), ...options], others === undefined ? "" : String(others));
    filters.push({ column, select });
  }
  if (quantities.length > 1) {
    const across = choose("axes", "across", quantityOptions(), told.chosen.across);
    const up = choose("axes", "up", quantityOptions(), told.chosen.up);
    const method = choose("axes", "method", methods.labels.map((name, k) => option(name, k)), 0);
    for (const side of ["left", "right"]) {
      const shown = choose(`${side}-shown`, "colour", shownOptions(), told.chosen[side]);
      pictures.push(() => drawMap(part(side), across.value, up.value, shown.value, ofMethod(kept(all), Number(method.value))));
    }
  }
  if (quantities.length) {
    const over = choose("curve-shown", "over", quantityOptions(), told.chosen.across);
    const options = [option("solved [%]", SOLVED), ...metricOptions()];
    const shown = choose("curve-shown", "show", options, SOLVED);
    pictures.push(() => drawCurve(part("curve"), over.value, shown.value, kept(all)));
  }
  if (metrics.length) {
    const shown = choose("share-shown", "distribution of", metricOptions(), 0);
    pictures.push(() => drawShares(part("share"), shown.value, kept(all)));
  }
  draw();
};
document.querySelectorAll(".explorer").forEach(explore);

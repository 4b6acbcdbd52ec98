// Plots of fields: the last seconds live, or a still picture. The URL's fragment (`#`) has the fields.
//
// uPlot draws them; `obk plot --html` uses the same copy. The stream continues behind a still picture.

import { replyOf } from "./dialog.js";
import { byId, element, keep, setText } from "./dom.js";
import { number } from "./format.js";

/* global uPlot */
export const MOST_CURVES = 12; // Limit of the server.
const SHOWN_S = 30;
const GAP_S = 1; // A longer time without messages is shown as a gap.
const COLOURS = 8;
const HEIGHT = 190;
const HINT = "Drag or turn the wheel to zoom, drag with Shift to move, double-click to show everything.";

const live = new Map(); // Curve -> its newest values.
const charts = new Map(); // Element of a plot -> its chart.
let still = null; // Curve -> lines of a still picture; null: live.
let shownRun = "";
let startedS = 0;
let nowS = 0;
let isAligning = false;

class Live {
  labels = [];
  rows = [];
  fault = "";

  take(data, now) {
    this.labels = data.labels;
    this.fault = data.fault;
    for (const row of data.rows) {
      const last = this.rows.at(-1);
      if (last && row[0] - last[0] > GAP_S) this.rows.push([last[0] + GAP_S]);
      this.rows.push(row);
    }
    const first = this.rows.findIndex((row) => row[0] >= now - SHOWN_S);
    this.rows.splice(0, first < 0 ? this.rows.length : first);
  }

  // A copy, so that later samples do not change the chart.
  get lines() {
    const times = this.rows.map((row) => row[0] - startedS);
    return this.labels.map((label, place) => ({ label, times, values: this.rows.map((row) => value(row[place + 1])) }));
  }
}

// Numbers that JSON lacks arrive as strings, missing ones as null.
function value(one) {
  return Number.isFinite(one) ? one : null;
}

// The plots in the URL, each a list of curves (`topic field`).
export function wantedPlots() {
  return new URLSearchParams(location.hash.slice(1)).getAll("plot").map((text) => text.split(","));
}

export function wantedCurves() {
  return [...new Set(wantedPlots().flat())];
}

export function setPlots(plots) {
  const wanted = plots.filter((curves) => curves.length);
  const query = new URLSearchParams(wanted.map((curves) => ["plot", curves.join(",")]));
  history.replaceState(null, "", `${location.pathname}#${query}`);
  for (const curve of live.keys()) if (!wanted.flat().includes(curve)) live.delete(curve);
}

// Each new stream starts with all stored samples.
export function beginCurves() {
  for (const curve of wantedCurves()) live.set(curve, new Live());
}

export function takeSamples(samples) {
  nowS = samples.now_s - startedS;
  for (const data of samples.curves) live.get(data.curve)?.take(data, samples.now_s);
  if (!still && !document.hidden) drawAll();
}

// A new run has a different time range, so its plots start live.
export function showRun(run, started) {
  if (run === shownRun) return;
  shownRun = run;
  startedS = started;
  setStill(null);
}

export function showPlots(remove) {
  const plots = wantedPlots();
  const items = plots.map((curves, place) => ({ curves, place }));
  byId("plot-tools").hidden = !plots.length;
  keep(byId("plots"), items, ({ place }) => String(place), card, (child, { curves, place }) => {
    child.dataset.curves = JSON.stringify(curves);
    keep(child.querySelector("header"), curves, (curve) => curve, signal,
      (one, curve) => { one.querySelector("button").onclick = () => remove(place, curve); });
  });
  for (const [child, { chart }] of charts) {
    if (child.isConnected) continue;
    chart.destroy();
    charts.delete(child);
  }
  offerTargets(plots);
  drawAll();
}

// If the whole run is shown, read it again to include new signals.
export function refreshStill() {
  if (still?.isWhole) showWholeRun();
}

function offerTargets(plots) {
  const target = byId("plot-target");
  const options = [{ key: "new", text: "in a new plot" },
    ...plots.map((curves, place) => ({ key: String(place), text: `with ${curves.map((one) => split(one)[1]).join(", ")}` }))];
  keep(target, options, (option) => option.key, (option) => element("option", { value: option.key }),
    (child, option) => setText(child, option.text));
  target.hidden = !plots.length;
}

function card() {
  const resized = new ResizeObserver(([{ target }]) => charts.get(target)?.chart.setSize(size(target)));
  const made = element("div", { className: "plot" },
    element("header"), element("p", { className: "fault" }), element("div", { className: "chart", role: "img" }),
    element("div", { className: "legend" }));
  resized.observe(made);
  return made;
}

function signal(curve) {
  const [topic, field] = split(curve);
  const button = element("button", { "aria-label": `remove ${curve}`, title: "remove" }, "×");
  return element("h3", {}, field, " ", element("small", {}, topic), " ", button);
}

export function split(curve) {
  const place = curve.indexOf(" ");
  return [curve.slice(0, place), curve.slice(place + 1)];
}

// Pause, and the whole run.

function setStill(picture) {
  still = picture;
  setText(byId("plot-pause"), still ? "Resume" : "Pause");
  setText(byId("plot-note"), still ? HINT : "");
  drawAll();
}

function pause() {
  if (still) return;
  const lines = new Map([...live].map(([curve, one]) => [curve, { lines: one.lines, fault: one.fault }]));
  setStill({ lines, isWhole: false });
}

async function showWholeRun() {
  const run = shownRun;
  const note = byId("plot-note");
  setText(note, "Reading the recording.");
  try {
    const answer = await fetch(`/history?${new URLSearchParams(wantedCurves().map((curve) => ["curve", curve]))}`);
    const reply = await replyOf(answer);
    if (!answer.ok || reply.run !== run) {
      setText(note, reply.why ?? "Another stack is running now.");
      return;
    }
    setStill({ lines: new Map(reply.curves.map((one) => [one.curve, recorded(one)])), isWhole: true });
    for (const { chart } of charts.values()) showEverything(chart);
  } catch {
    setText(note, "The server does not answer.");
  }
}

// The recorded lines of a curve, followed by messages received since.
function recorded({ curve, lines, fault }) {
  const newest = live.get(curve)?.lines ?? [];
  return {
    fault,
    lines: lines.map(({ label, times, values }) => {
      const known = { label, times: numbers(times).map((t) => t - startedS), values: numbers(values).map(value) };
      const later = newest.find((one) => one.label === label);
      later?.times.forEach((t, place) => {
        if (t <= known.times.at(-1)) return;
        known.times.push(t);
        known.values.push(later.values[place]);
      });
      return known;
    }),
  };
}

function numbers(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return Array.from(new Float64Array(bytes.buffer));
}

byId("plot-pause").addEventListener("click", () => (still ? setStill(null) : pause()));
byId("plot-whole").addEventListener("click", showWholeRun);

// Charts.

function drawAll() {
  for (const child of byId("plots").children) draw(child);
}

function draw(child) {
  const curves = JSON.parse(child.dataset.curves);
  const found = curves.map((curve) => (still ? still.lines.get(curve) : live.get(curve)) ?? { lines: [], fault: "" });
  const faults = found.map((one) => one.fault).filter(Boolean);
  const fault = child.querySelector(".fault");
  setText(fault, faults.join("\n"));
  fault.hidden = !faults.length;
  const lines = found.flatMap((one, place) => one.lines.map((line) => ({ ...line, label: labelOf(curves, place, line.label) })));
  const key = JSON.stringify([curves, lines.map((line) => line.label)]);
  const known = charts.get(child);
  if (known?.key !== key) {
    known?.chart.destroy();
    charts.set(child, { key, chart: makeChart(child, lines) });
  }
  const { chart } = charts.get(child);
  chart.batch(() => {
    chart.setData(joined(lines), false);
    const isNew = known?.key !== key;
    if (!still) chart.setScale("x", { min: nowS - SHOWN_S, max: nowS });
    else if (isNew) alignWithOthers(chart);
  });
  describe(chart);
  showLegend(chart);
}

// If a plot has fields of several topics, labels include the topic.
function labelOf(curves, place, label) {
  const topics = new Set(curves.map((curve) => split(curve)[0]));
  return topics.size > 1 ? `${split(curves[place])[0].split("/").pop()}.${label}` : label;
}

function joined(lines) {
  return lines.length ? uPlot.join(lines.map((line) => [line.times, line.values])) : [[]];
}

function size(child) {
  const { paddingLeft, paddingRight } = getComputedStyle(child);
  return { width: child.clientWidth - parseFloat(paddingLeft) - parseFloat(paddingRight), height: HEIGHT };
}

function makeChart(child, lines) {
  const colour = (name) => () => getComputedStyle(child).getPropertyValue(name);
  const axis = { stroke: colour("--faint"), grid: { stroke: colour("--line"), width: 1 }, ticks: { show: false },
    font: `11px ${getComputedStyle(child).getPropertyValue("--mono")}` };
  const options = {
    ...size(child),
    legend: { show: false },
    padding: [8, 8, 0, 0],
    scales: { x: { time: false }, y: { range: room } },
    series: [{}, ...lines.map((line, place) => ({
      label: line.label,
      stroke: colour(`--curve-${place % COLOURS}`),
      dash: place < COLOURS ? [] : [6, 4],
      width: 1.5,
      points: { size: 4 },
    }))],
    axes: [
      { ...axis, size: 26, gap: 3, values: (_, ticks) => ticks.map((tick) => `${Number(tick.toPrecision(12))} s`) },
      { ...axis, size: 58, gap: 6, values: (_, ticks) => ticks.map((tick) => tickText(tick, ticks.at(-1) - ticks[0])) },
    ],
    cursor: {
      y: false,
      drag: { x: true, y: false },
      sync: { key: "obk", setSeries: false },
      bind: { mousedown: (_, __, start) => (event) => { if (!event.shiftKey) start(event); } },
      dataIdx: (chart, place, at) => (place ? newestAt(chart, place, at) : at),
    },
    hooks: {
      setSelect: [pause],
      setScale: [(chart, key) => key === "x" && align(chart)],
      setCursor: [showLegend],
      ready: [(chart) => moveByHand(chart)],
    },
  };
  return new uPlot(options, joined(lines), child.querySelector(".chart"));
}

// The wheel zooms at the cursor; Shift-drag moves. Both make the picture still.
function moveByHand(chart) {
  const over = chart.over;
  over.addEventListener("wheel", (event) => {
    event.preventDefault();
    pause();
    const { min, max } = chart.scales.x;
    const middle = chart.posToVal(event.offsetX, "x");
    const factor = event.deltaY < 0 ? 0.8 : 1.25;
    chart.setScale("x", { min: middle - (middle - min) * factor, max: middle + (max - middle) * factor });
  }, { passive: false });
  over.addEventListener("pointerdown", (down) => {
    if (!down.shiftKey || down.button) return;
    pause();
    over.setPointerCapture(down.pointerId);
    const { min, max } = chart.scales.x;
    const perPixel = (max - min) / over.clientWidth;
    const move = (event) => {
      const way = (down.clientX - event.clientX) * perPixel;
      chart.setScale("x", { min: min + way, max: max + way });
    };
    over.addEventListener("pointermove", move);
    over.addEventListener("pointerup", () => over.removeEventListener("pointermove", move), { once: true });
  });
  over.addEventListener("dblclick", (event) => {
    event.stopImmediatePropagation();
    pause();
    showEverything(chart);
  }, { capture: true });
}

// All charts show the same time range.
function align(source) {
  describe(source);
  if (isAligning || !still) return;
  const { min, max } = source.scales.x;
  isAligning = true;
  for (const { chart } of charts.values()) if (chart !== source) chart.setScale("x", { min, max });
  isAligning = false;
}

function describe(chart) {
  const { min, max } = chart.scales.x;
  const shown = still && min !== null ? `${min.toFixed(2)} to ${max.toFixed(2)} s` : "the last seconds";
  chart.root.parentElement.setAttribute("aria-label", shown);
}

function alignWithOthers(chart) {
  const other = [...charts.values()].map((one) => one.chart).find((one) => one !== chart && one.scales.x.min !== null);
  const { min, max } = other?.scales.x ?? { min: nowS - SHOWN_S, max: nowS };
  chart.setScale("x", { min, max });
}

function showEverything(source) {
  const times = [...charts.values()].flatMap(({ chart }) => [chart.data[0][0], chart.data[0].at(-1)]).filter((t) => t !== undefined);
  if (times.length) source.setScale("x", { min: Math.min(...times), max: Math.max(...times) });
}

function room(_, low, high) {
  if (low === null || low === undefined) return [-1, 1];
  const margin = (high - low) * 0.06 || Math.abs(high) * 0.1 || 1;
  return [low - margin, high + margin];
}

// Values at the cursor, otherwise the newest ones.
function showLegend(chart) {
  const at = chart.cursor.left >= 0 ? chart.cursor.idx : null;
  const last = chart.data[0].length - 1;
  const shown = at ?? last;
  const time = at === null || at === undefined ? null : chart.data[0][at];
  const lines = chart.series.slice(1).map((series, place) => ({ label: series.label, place }));
  const legend = chart.root.closest(".plot").querySelector(".legend");
  const items = [...lines, ...(time === null ? [] : [{ label: "t", place: -1 }])];
  keep(legend, items, (one) => `${one.place} ${one.label}`,
    (one) => element("span", {},
      element("i", { className: one.place < 0 ? "time" : `curve-${one.place % COLOURS}${one.place < COLOURS ? "" : " dashed"}` }),
      one.label, element("b")),
    (child, one) => {
      const text = one.place < 0 ? `${time.toFixed(3)} s` : number(valueAt(chart, one.place + 1, shown));
      setText(child.querySelector("b"), text);
    });
}

// Lines of other topics rarely have a value at exactly the cursor's time; use the previous one.
function newestAt(chart, place, at) {
  const values = chart.data[place];
  let found = at;
  while (found > 0 && values[found] === undefined) found -= 1;
  return found;
}

function valueAt(chart, place, at) {
  return at < 0 ? null : chart.data[place][newestAt(chart, place, at)];
}

function tickText(tick, span) {
  const most = Math.max(Math.abs(tick), span);
  if (most >= 1e5 || most < 1e-3) return tick.toExponential(1);
  return String(Number(tick.toPrecision(5)));
}

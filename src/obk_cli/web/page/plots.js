// Fields over the last seconds, drawn on canvases. Which ones is kept in the address, behind `#`.

import { byId, element, keep, setText } from "./dom.js";
import { number } from "./format.js";

const SHOWN_S = 30;
const COLOURS = 8;
const MARGIN = { left: 58, right: 8, top: 6, bottom: 18 };

const plots = new Map();

class Plot {
  constructor(curve) {
    this.curve = curve;
    this.labels = [];
    this.rows = [];
    this.fault = "";
  }

  take(data, now) {
    this.labels = data.labels;
    this.fault = data.fault;
    this.rows.push(...data.rows);
    const first = this.rows.findIndex((row) => row[0] >= now - SHOWN_S);
    this.rows.splice(0, first < 0 ? this.rows.length : first);
  }
}

// The curves that are wanted, as the address has them.
export function wantedCurves() {
  return new URLSearchParams(location.hash.slice(1)).getAll("plot");
}

export function setCurves(curves) {
  const query = new URLSearchParams(curves.map((curve) => ["plot", curve]));
  history.replaceState(null, "", `${location.pathname}#${query}`);
  for (const curve of plots.keys()) if (!curves.includes(curve)) plots.delete(curve);
}

// Each new stream starts with all samples that are kept.
export function beginCurves() {
  for (const curve of wantedCurves()) plots.set(curve, new Plot(curve));
}

export function takeSamples(samples) {
  for (const data of samples.curves) plots.get(data.curve)?.take(data, samples.now_s);
  if (!document.hidden) draw(samples.now_s);
}

export function showPlots(remove) {
  keep(byId("plots"), wantedCurves(), (curve) => curve, (curve) => card(curve, remove), () => {});
}

function card(curve, remove) {
  const [topic, field] = split(curve);
  const button = element("button", { "aria-label": `remove ${curve}`, title: "remove" }, "×");
  button.addEventListener("click", () => remove(curve));
  return element("div", { className: "plot" },
    element("header", {}, element("h3", {}, field, " ", element("small", {}, topic)), button),
    element("p", { className: "fault" }),
    element("canvas", { role: "img", "aria-label": curve }),
    element("div", { className: "legend" }));
}

export function split(curve) {
  const place = curve.indexOf(" ");
  return [curve.slice(0, place), curve.slice(place + 1)];
}

function draw(now) {
  for (const child of byId("plots").children) {
    const plot = plots.get(child.dataset.key);
    if (!plot) continue;
    const fault = child.querySelector(".fault");
    setText(fault, plot.fault);
    fault.hidden = !plot.fault;
    showLegend(child.querySelector(".legend"), plot);
    drawCanvas(child.querySelector("canvas"), plot, now);
  }
}

function showLegend(legend, plot) {
  const last = plot.rows.at(-1);
  keep(legend, plot.labels.map((label, place) => ({ label, place })), (one) => one.label,
    (one) => element("span", {}, element("i", { className: `curve-${one.place % COLOURS}` }),
      one.label, element("b")),
    (child, one) => setText(child.querySelector("b"), number(last?.[one.place + 1])));
}

function drawCanvas(canvas, plot, now) {
  const scale = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const style = getComputedStyle(canvas);
  const colour = (name) => style.getPropertyValue(name);
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = `11px ${colour("--mono")}`;
  const [low, high] = range(plot.rows);
  const inner = { width: width - MARGIN.left - MARGIN.right, height: height - MARGIN.top - MARGIN.bottom };
  const x = (time) => MARGIN.left + inner.width * (1 + (time - now) / SHOWN_S);
  const y = (value) => MARGIN.top + inner.height * (1 - (value - low) / (high - low));

  context.strokeStyle = colour("--line");
  context.fillStyle = colour("--faint");
  context.lineWidth = 1;
  context.beginPath();
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const tick of ticks(low, high)) {
    const level = Math.round(y(tick)) + 0.5;
    context.moveTo(MARGIN.left, level);
    context.lineTo(width - MARGIN.right, level);
    context.fillText(tickText(tick, high - low), MARGIN.left - 6, level);
  }
  context.textBaseline = "bottom";
  for (let ago = 0; ago <= SHOWN_S; ago += 10) {
    context.textAlign = ago ? "center" : "right";
    context.fillText(ago ? `−${ago} s` : "now", x(now - ago) + (ago === SHOWN_S ? 14 : 0), height - 2);
  }
  context.stroke();
  drawLines(context, plot, x, y, colour);
}

function drawLines(context, plot, x, y, colour) {
  context.save();
  context.lineWidth = 1.5;
  context.lineJoin = "round";
  plot.labels.forEach((_, place) => {
    context.strokeStyle = colour(`--curve-${place % COLOURS}`);
    context.beginPath();
    let before = null;
    for (const row of plot.rows) {
      const value = row[place + 1];
      if (!isNumber(value)) {
        before = null;
        continue;
      }
      // A second without messages is a gap, not a line.
      const joins = before !== null && row[0] - before < 1;
      context[joins ? "lineTo" : "moveTo"](x(row[0]), y(value));
      before = row[0];
    }
    context.stroke();
  });
  context.restore();
}

// Numbers that JSON does not have come as texts, missing ones as null.
function isNumber(value) {
  return typeof value === "number";
}

function range(rows) {
  let [low, high] = [Infinity, -Infinity];
  for (const row of rows) {
    for (let place = 1; place < row.length; place += 1) {
      if (!isNumber(row[place])) continue;
      low = Math.min(low, row[place]);
      high = Math.max(high, row[place]);
    }
  }
  if (low > high) return [-1, 1];
  const room = (high - low) * 0.06 || Math.abs(high) * 0.1 || 1;
  return [low - room, high + room];
}

function ticks(low, high) {
  const rough = (high - low) / 4;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough);
  const found = [];
  for (let place = Math.ceil(low / step); place * step <= high; place += 1) found.push(place * step);
  return found;
}

function tickText(tick, span) {
  const size = Math.max(Math.abs(tick), span);
  if (size >= 1e5 || size < 1e-3) return tick.toExponential(1);
  return String(Number(tick.toPrecision(5)));
}

"use strict";
// The plots of the page: one for each part, with a common cursor and a common range of times.
const COLOURS = ["#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#e377c2",
                 "#7f7f7f", "#bcbd22", "#17becf"];
const DASHES = [[], [8, 4], [2, 3], [8, 3, 2, 3]];
const HEIGHT = 260;
const data = JSON.parse(document.getElementById("data").textContent);
const root = document.getElementById("plots");
const plots = [];

function numbers(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return Array.from(new Float64Array(bytes.buffer));
}

// NaN is a gap: uPlot draws none of it, and JSON has no word for it.
function values(text) {
  return numbers(text).map((value) => (Number.isFinite(value) ? value : null));
}

function width() {
  return Math.max(400, document.documentElement.clientWidth - 32);
}

let isZooming = false;

// All plots show the same times.
function follow(source) {
  if (isZooming) return;
  isZooming = true;
  const { min, max } = source.scales.x;
  for (const plot of plots) {
    if (plot !== source) plot.setScale("x", { min, max });
  }
  isZooming = false;
}

// A line in the style of a series, because the marker of uPlot shows only its colour.
function marker(line) {
  const svg = `<svg xmlns="http://www.w3.org/2000/svg" width="32" height="8">
    <path d="M0 4H32" stroke="${COLOURS[line.colour % COLOURS.length]}" stroke-width="2"
      stroke-dasharray="${DASHES[line.run % DASHES.length]}"/></svg>`;
  return `url("data:image/svg+xml,${encodeURIComponent(svg)}")`;
}

function show(part) {
  const tables = part.lines.map((line) => [numbers(line.times), values(line.values)]);
  const series = part.lines.map((line) => ({
    label: line.label || part.label,
    stroke: COLOURS[line.colour % COLOURS.length],
    dash: DASHES[line.run % DASHES.length],
    width: 1,
    spanGaps: true,
    points: { show: false },
    value: (plot, value) => (value === null || value === undefined ? "-" : value.toPrecision(6)),
  }));
  const options = {
    width: width(),
    height: HEIGHT,
    series: [{ label: "t [s]", value: (plot, t) => (t === null ? "-" : t.toFixed(4)) }, ...series],
    scales: { x: { time: false } },
    axes: [{ label: "time since activation [s]" }, { label: part.label, size: 70 }],
    legend: { markers: { width: 0, fill: (plot, index) => marker(part.lines[index - 1]) } },
    cursor: { sync: { key: "obk", setSeries: false }, drag: { x: true, y: false } },
    hooks: { setScale: [(plot, key) => key === "x" && follow(plot)] },
  };
  const joined = tables.length === 1 ? tables[0] : uPlot.join(tables);
  plots.push(new uPlot(options, joined, root));
}

data.parts.forEach(show);
if (data.xlim !== null && plots.length) {
  plots[0].setScale("x", { min: data.xlim[0], max: data.xlim[1] });
}
const thinned = data.parts.some((part) => part.lines.some(
  (line) => atob(line.times).length / 8 < line.points));
if (thinned) {
  document.getElementById("note").textContent =
    "Long lines show only the minimum and maximum of each group of points.";
}
window.addEventListener("resize", () => {
  for (const plot of plots) plot.setSize({ width: width(), height: HEIGHT });
});
window.obkPlots = plots;

// Show a running stack as reported by the server, and request transitions.

import { LOST, confirmed, notice, post } from "./dialog.js";
import { byId, element, keep, setText } from "./dom.js";
import { MISSING, clock, commonSpace, milliseconds, rate, shortNode } from "./format.js";
import { showGraph } from "./graph.js";
import { showParameters } from "./parameters.js";
import {
  MOST_CURVES, beginCurves, refreshStill, setPlots, showPlots, showRun, takeSamples, wantedCurves, wantedPlots,
} from "./plots.js";
import "./save.js";

// Transitions that need confirmation, because they move the robot or cannot be undone.
const QUESTIONS = {
  activate: (what) => `Activate ${what}? A robot may move.`,
  shutdown: (what) => `Shut ${what} down? It cannot be brought up again in this run.`,
};

// Results as text; others are shown as they are.
const RESULTS = { "already there": "already in that state" };

let stream = null;
let view = null;
let isAsking = false;

function connect() {
  stream?.close();
  beginCurves();
  const query = new URLSearchParams(wantedCurves().map((curve) => ["curve", curve]));
  stream = new EventSource(`/events?${query}`);
  const on = (name, take) => stream.addEventListener(name, (event) => take(JSON.parse(event.data)));
  on("view", showView);
  on("waiting", () => notice("No stack is running; waiting for one (obk launch)."));
  on("log", (data) => showLog(data.lines));
  on("samples", takeSamples);
  stream.addEventListener("open", () => {
    if (byId("notice").dataset.text === LOST) notice("");
    beginCurves();
  });
  stream.addEventListener("error", () => {
    if (stream.readyState === EventSource.CLOSED) setTimeout(connect, 2000);
    notice(LOST);
  });
}

function showView(shown) {
  const wasWaiting = view === null || view.is_waiting;
  view = shown;
  if (shown.is_waiting) {
    const cause = shown.cause ? `: ${shown.cause}` : "";
    notice(`${shown.name || "The stack"} has ended${cause}\nWaiting for the next one.`, shown.cause ? "bad" : "");
  } else if (wasWaiting) {
    notice("");
  }
  document.body.classList.toggle("ended", shown.is_waiting);
  document.title = `${shown.name || "obk"}: ${standing(shown)}`;
  setText(byId("name"), shown.name || "launched elsewhere");
  showState(byId("state"), standing(shown), shown.is_waiting);
  showRun(shown.run, shown.started_s);
  showFacts(shown);
  const actions = shown.is_waiting ? [] : shown.transitions;
  showButtons(byId("stack-buttons"), actions, "", `the whole stack ${shown.name}`);
  showNodes(shown);
  showTopics(shown);
  offerTopics(shown.topics);
  showGraph(shown);
  showParameters(shown);
}

function standing(shown) {
  return shown.has_ended ? "ended" : shown.state || shown.phase || "no answer";
}

function showState(target, state, isWrong = false) {
  setText(target, state);
  const rests = ["unconfigured", "inactive", "finalized", "ended", ""].includes(state);
  const kind = state === "active" ? "active" : isWrong || state === "hangs" ? "wrong" : rests ? "" : "passing";
  target.className = `state ${kind}`;
}

function showFacts(shown) {
  const off = shown.topics.filter((topic) => topic.is_off).length;
  const facts = [
    ["up", clock(shown.uptime_s)],
    ["domain", String(shown.domain)],
    ["real time", shown.realtime_factor === null ? null : `×${shown.realtime_factor.toFixed(2)}`],
    ["topics off", off ? String(off) : null],
    ["this page costs", `${shown.cost_percent.toFixed(1)} % of a core`],
  ].filter(([, value]) => value !== null);
  keep(byId("facts"), facts, ([name]) => name,
    ([name]) => element("div", {}, element("dt", {}, name), element("dd")),
    (child, [, value]) => setText(child.lastChild, value));
}

function showNodes(shown) {
  keep(byId("nodes").tBodies[0], shown.nodes, (node) => node.node, nodeRow, (row, node) => {
    const [name, state, cpu, memory, actions] = row.cells;
    showPage(name.children[1], node.page);
    name.title = `${node.node}\n${node.section}${node.pid === null ? "" : `, process ${node.pid}`}`;
    setText(name.firstChild, shortNode(node.node));
    row.classList.toggle("off", isSlowSimulation(node));
    const broken = node.rates.filter((one) => one.standing !== "kept");
    const words = [
      node.restarts ? `restarted ${node.restarts}×` : "",
      ...broken.map((one) => `${one.name} ${rate(one.measured_hz)} of ${rate(one.expected_hz)} Hz`),
    ].filter(Boolean);
    setText(name.lastChild, words.join(", "));
    name.lastChild.hidden = !words.length;
    showState(state.firstChild, node.hangs ? "hangs" : node.state);
    const shared = node.shares_process ? "+" : "";
    setText(cpu, node.load ? `${node.load.cpu_percent.toFixed(1)}${shared}` : MISSING);
    setText(memory, node.load ? `${(node.load.memory_bytes / 1e6).toFixed(0)}${shared}` : MISSING);
    showButtons(actions.firstChild, shown.is_waiting ? [] : node.transitions, node.node, shortNode(node.node));
  });
}

function showPage(link, url) {
  link.hidden = !url;
  if (url) link.href = url;
  else link.removeAttribute("href");
}

function isSlowSimulation(node) {
  return node.rates.some((one) => one.name === "steps" && one.standing !== "kept");
}

function nodeRow() {
  return element("tr", {},
    element("td", { className: "name" }, element("span"),
      element("a", { className: "view", target: "_blank", rel: "noopener", title: "the page of the simulation" }, "view"),
      element("div", { className: "detail" })),
    element("td", {}, element("span", { className: "state" })),
    element("td", { className: "number" }), element("td", { className: "number" }),
    element("td", { className: "actions" }, element("div", { className: "buttons" })));
}

function showTopics(shown) {
  const space = commonSpace(shown.topics.map((topic) => topic.topic));
  setText(byId("topic-title"), space ? `topic in ${space}` : "topic");
  keep(byId("topics").tBodies[0], shown.topics, (topic) => topic.topic, topicRow, (row, topic) => {
    const [name, measured, wanted, jitter, age] = row.cells;
    setText(name.firstChild, topic.topic.slice(space.length));
    name.title = [
      topic.topic,
      topic.msg_type ?? "unknown type",
      `${topic.publishers} publishing, ${topic.subscriptions} subscribed`,
    ].join("\n");
    row.classList.toggle("off", topic.is_off);
    setText(measured, topic.rate ? rate(topic.rate.rate_hz ?? 0) : MISSING);
    setText(wanted, rate(topic.expected_hz));
    setText(jitter, milliseconds(topic.rate?.jitter_s));
    setText(age, milliseconds(topic.age?.p50_s));
  });
}

function topicRow(topic) {
  const button = element("button", { title: `plot a field of ${topic.topic}` }, "plot");
  button.addEventListener("click", () => {
    byId("plot-topic").value = topic.topic;
    offerFields(topic.topic);
    byId("plot-field").focus();
  });
  return element("tr", {}, element("td", { className: "name" }, element("span")),
    element("td", { className: "number rate" }), element("td", { className: "number unwanted" }),
    element("td", { className: "number" }), element("td", { className: "number" }),
    element("td", { className: "actions" }, button));
}

function showButtons(target, transitions, node, what) {
  keep(target, transitions, (name) => name, (name) => {
    const kind = name === "activate" ? "moves" : name === "shutdown" ? "ends" : "";
    const button = element("button", { className: kind, title: `${name} ${what}` }, name);
    button.addEventListener("click", () => change(name, node, what));
    return button;
  }, (button) => {
    button.disabled = isAsking;
  });
}

async function change(transition, node, what) {
  const { run } = view; // Another stack may be running when the user answers.
  if (QUESTIONS[transition] && !(await confirmed(QUESTIONS[transition](what), transition))) return;
  isAsking = true;
  for (const button of document.querySelectorAll(".buttons button")) button.disabled = true;
  try {
    showAnswer(await post("/change", { transition, node, run }), transition, what);
  } catch {
    notice(LOST);
  } finally {
    isAsking = false;
    for (const button of document.querySelectorAll(".buttons button")) button.disabled = false;
  }
}

function showAnswer(answer, transition, what) {
  if (answer.success) {
    const results = answer.members.map((one) => `${shortNode(one.node)} ${one.state}`);
    notice(`${transition}: ${results.join(", ") || what}`, "good");
    return;
  }
  const faults = answer.members
    .filter((one) => one.result !== "reached" || one.fault)
    .map((one) => `${shortNode(one.node)}: ${RESULTS[one.result] ?? one.result}, now ${one.state}${one.fault ? `: ${one.fault}` : ""}`);
  notice([`${transition} of ${what} failed: ${answer.why}`, ...faults].join("\n"), "bad");
}

function showLog(lines) {
  const log = byId("log");
  const isAtEnd = log.scrollHeight - log.scrollTop - log.clientHeight < 8;
  log.replaceChildren(...lines.map((line) => element("li", { className: lineKind(line) }, line)));
  if (isAtEnd) log.scrollTop = log.scrollHeight;
}

function lineKind(line) {
  if (/\[(ERROR|FATAL)\]|^failed: /.test(line)) return "error";
  return line.includes("[WARN]") ? "warning" : "";
}

function offerTopics(topics) {
  const options = topics.filter((topic) => topic.msg_type);
  keep(byId("plot-topic"), options, (topic) => topic.topic,
    (topic) => element("option", { value: topic.topic }, topic.topic), () => {});
  if (byId("plot-topic").dataset.offered !== byId("plot-topic").value) offerFields(byId("plot-topic").value);
}

async function offerFields(topic) {
  byId("plot-topic").dataset.offered = topic;
  const list = byId("plot-fields");
  list.replaceChildren();
  if (!topic) return;
  const answer = await fetch(`/fields?${new URLSearchParams({ topic })}`);
  if (!answer.ok || byId("plot-topic").value !== topic) return;
  const { fields } = await answer.json();
  list.replaceChildren(...fields.map((field) => element("option", { value: field })));
}

function changePlots(plots) {
  setPlots(plots);
  showPlots((place, curve) => changePlots(
    wantedPlots().map((curves, at) => (at === place ? curves.filter((one) => one !== curve) : curves))));
  connect();
  refreshStill();
}

byId("plot-topic").addEventListener("change", () => offerFields(byId("plot-topic").value));
byId("plot-form").addEventListener("submit", (event) => {
  event.preventDefault();
  const [topic, field] = [byId("plot-topic").value, byId("plot-field").value.trim()];
  if (!topic || !field) return;
  const curve = `${topic} ${field}`;
  if (!wantedCurves().includes(curve) && wantedCurves().length >= MOST_CURVES) {
    notice(`At most ${MOST_CURVES} fields are plotted; remove one first.`);
    return;
  }
  byId("plot-field").value = "";
  const plots = wantedPlots();
  const target = plots[byId("plot-target").value];
  if (!target) plots.push([curve]);
  else if (!target.includes(curve)) target.push(curve);
  changePlots(plots);
});
window.addEventListener("hashchange", () => changePlots(wantedPlots()));
// The token is a cookie by now, so remove it from the URL and the history; plots are kept.
changePlots(wantedPlots());

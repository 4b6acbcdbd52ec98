// The tunable parameters: a slider if the parameter has a range, otherwise a field.

import { post } from "./dialog.js";
import { byId, element, keep, setText } from "./dom.js";
import { shortNode } from "./format.js";

const PERIOD_MS = 5000; // Refresh interval, because other programs may change values.

let run = "";
let states = "";
let isAsking = false;
let changes = 0;

// Read the parameters when the stack or the state of a node has changed.
export function showParameters(view) {
  const present = view.is_waiting ? "" : JSON.stringify([view.run, view.nodes.map((node) => [node.node, node.state])]);
  if (present === states) return;
  states = present;
  run = view.run;
  if (view.is_waiting) disable();
  else read();
}

setInterval(() => {
  if (states && !document.hidden) read();
}, PERIOD_MS);

async function read() {
  if (isAsking) return;
  isAsking = true;
  const before = changes;
  try {
    const answer = await fetch("/parameters");
    if (!answer.ok) return;
    const { nodes } = await answer.json();
    // Values read before the user's last change must not overwrite it.
    if (before === changes) show(nodes);
  } catch {
    // The page itself reports a lost connection.
  } finally {
    isAsking = false;
  }
}

function show(nodes) {
  byId("parameters-panel").hidden = !nodes.length;
  keep(byId("parameters"), nodes, (node) => node.node, makeNode, (group, node) => {
    keep(group.lastChild, node.parameters, (one) => `${one.name} ${one.kind}`,
      (one) => makeRow(node.node, one), changeRow);
  });
}

function disable() {
  for (const control of byId("parameters").querySelectorAll("input, select, button")) control.disabled = true;
}

function makeNode(node) {
  return element("div", {}, element("h3", { title: node.node }, shortNode(node.node)), element("div"));
}

function makeRow(node, one) {
  const row = element("div", { className: "parameter" });
  const details = [one.description, one.range && `${one.range} ${one.unit}`, one.live ? "" : "takes effect at the next `configure` transition"];
  const name = element("span", { className: "name", title: details.filter(Boolean).join("\n") }, one.name);
  const label = `${shortNode(node)} ${one.name}`;
  const controls = makeControls(one, label);
  const unit = element("span", { className: "unit" }, one.unit);
  const reset = element("button", { "aria-label": `reset ${label}` }, "reset");
  const status = element("output");
  const send = sender(node, one.name, status);
  for (const control of controls) {
    const isSlider = control.type === "range";
    control.addEventListener(isSlider ? "input" : "change", () => {
      const value = valueOf(control);
      for (const other of controls) if (other !== control) setValue(other, value);
      send(value);
    });
  }
  reset.addEventListener("click", () => {
    for (const control of controls) setValue(control, reset.dataset.initial);
    send(reset.dataset.initial);
  });
  row.append(name, ...controls, unit, reset, status);
  return row;
}

function makeControls(one, label) {
  const attributes = { "aria-label": label };
  if (one.kind === "bool") return [element("input", { ...attributes, type: "checkbox", className: "wide" })];
  if (one.choices.length) {
    return [element("select", { ...attributes, className: "wide" }, ...one.choices.map((choice) => element("option", {}, choice)))];
  }
  const field = { ...attributes, type: "text", inputmode: one.step === null ? "text" : "decimal", autocomplete: "off", spellcheck: "false" };
  if (one.least === null || one.most === null) return [element("input", { ...field, className: "wide" })];
  const slider = { ...attributes, type: "range", min: one.least, max: one.most, step: one.step, "aria-label": `${label} slider` };
  return [element("input", slider), element("input", field)];
}

function changeRow(row, one) {
  const controls = [...row.querySelectorAll("input, select")];
  for (const control of controls) {
    control.disabled = false;
    if (control !== document.activeElement || control.type === "range") setValue(control, one.text);
  }
  const reset = row.querySelector("button");
  reset.dataset.initial = one.initial ?? "";
  reset.disabled = one.initial === null || one.initial === one.text;
  reset.title = one.initial === null ? "" : `reset to ${one.initial}`;
}

function valueOf(control) {
  return control.type === "checkbox" ? String(control.checked) : control.value;
}

function setValue(control, value) {
  if (control.type === "checkbox") control.checked = value === "true";
  else if (control.value !== value) control.value = value;
}

// Send the newest value; requests are sequential, because a slider produces many values.
function sender(node, name, status) {
  let wanted = null;
  let isSending = false;
  return async (value) => {
    wanted = value;
    changes += 1;
    if (isSending) return;
    isSending = true;
    while (wanted !== null) {
      const text = wanted;
      wanted = null;
      try {
        const reply = await post("/parameter", { node, name, value: text, run });
        setText(status, reply.why);
        status.className = reply.success ? "" : "bad";
      } catch {
        setText(status, "the server does not answer");
        status.className = "bad";
      }
    }
    isSending = false;
    changes += 1;
    read();
  };
}

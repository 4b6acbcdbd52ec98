// The notice under the header, and confirmations.

import { byId, element, setText } from "./dom.js";

export const LOST = "The server does not answer; trying again.";

export function notice(text, kind = "") {
  const target = byId("notice");
  target.dataset.text = text;
  target.hidden = !text;
  target.className = kind;
  const close = element("button", { "aria-label": "close" }, "×");
  close.addEventListener("click", () => notice(""));
  target.replaceChildren(close, text);
}

// Ask for confirmation; return whether the user agrees. `diff` is shown below the question by line.
export function confirmed(question, verb, diff = "") {
  const dialog = byId("confirm");
  setText(byId("confirm-text"), question);
  setText(byId("confirm-yes"), verb);
  const lines = diff.trimEnd().split("\n").map((line) => element("span", { className: lineKind(line) }, `${line}\n`));
  byId("confirm-diff").hidden = !diff;
  byId("confirm-diff").replaceChildren(...lines);
  dialog.returnValue = "no";
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => resolve(dialog.returnValue === "yes"), { once: true });
  });
}

function lineKind(line) {
  if (/^(---|\+\+\+|@@) /.test(line)) return "place";
  return { "+": "added", "-": "removed" }[line[0]] ?? "";
}

// The JSON reply of a request; the server's errors are JSON, too.
export async function replyOf(answer) {
  const isReply = answer.headers.get("Content-Type")?.startsWith("application/json");
  return isReply ? answer.json() : { success: false, why: await answer.text(), members: [] };
}

export async function post(path, body) {
  return replyOf(await fetch(path, {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify(body),
  }));
}

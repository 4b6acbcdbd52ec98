// Write the tuned parameters into the config, after the user has seen the edit.

import { byId } from "./dom.js";
import { LOST, confirmed, notice, post, replyOf } from "./dialog.js";

async function save() {
  const edit = await replyOf(await fetch("/save"));
  if (edit.success === false) {
    notice(edit.why, "bad");
    return;
  }
  const faults = [
    ...edit.faults.map((fault) => `Not written, edit it by hand: ${fault}`),
    ...edit.missing_nodes.map((node) => `${node} is not running; its values are unchanged.`),
  ];
  if (!edit.diff) {
    notice([`${edit.config}: nothing to write.`, ...faults].join("\n"), faults.length ? "bad" : "");
    return;
  }
  const question = [`Write these values into ${edit.config}?`, ...faults].join("\n");
  if (!(await confirmed(question, "write", edit.diff))) return;
  const reply = await post("/save", { run: edit.run, digest: edit.digest });
  notice(reply.why, reply.success ? "good" : "bad");
}

const button = byId("save-parameters");
button.addEventListener("click", async () => {
  button.disabled = true;
  try {
    await save();
  } catch {
    notice(LOST);
  } finally {
    button.disabled = false;
  }
});

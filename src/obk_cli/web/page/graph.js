// The picture of the stack, with measured values in the last line of each box.

import { byId } from "./dom.js";
import { rate } from "./format.js";

let shown = null;

export async function showGraph(view) {
  const panel = byId("graph-panel");
  panel.hidden = !view.has_picture;
  if (!view.has_picture) return;
  if (shown !== view.run) {
    shown = view.run;
    const answer = await fetch("/graph");
    const picture = new DOMParser().parseFromString(await answer.text(), "image/svg+xml");
    byId("graph").replaceChildren(document.importNode(picture.documentElement, true));
  }
  const boxes = [...byId("graph").querySelectorAll("g[data-node], g[data-topic]")];
  const nodes = new Map(view.nodes.map((node) => [node.node, node]));
  const topics = new Map(view.topics.map((topic) => [topic.topic, topic]));
  for (const box of boxes) {
    const live = box.querySelector(".live");
    const node = nodes.get(box.dataset.node);
    const topic = topics.get(box.dataset.topic);
    if (node) {
      live.textContent = node.hangs ? "hangs" : node.state;
      live.setAttribute("class", `live ${node.hangs ? "wrong" : node.state}`);
    } else if (topic) {
      live.textContent = topic.rate ? rateText(topic) : "";
      live.setAttribute("class", `live ${topic.is_off ? "wrong" : topic.rate?.rate_hz ? "kept" : ""}`);
      box.classList.toggle("off", topic.is_off);
    }
  }
}

function rateText(topic) {
  const measured = topic.rate.rate_hz === null ? "0" : rate(topic.rate.rate_hz);
  return topic.expected_hz === null ? `${measured} Hz` : `${measured} of ${rate(topic.expected_hz)} Hz`;
}

// What the page says of the recording: that it runs, or in words why not; and the operator's markers.

import { byId, setText } from "./format.js";

/** @param ask called with ("mark", null, text) */
export function markers(ask) {
  const mark = () => ask("mark", null, "Marker");
  byId("mark").addEventListener("click", (event) => {
    mark();
    event.target.blur(); // the space bar drives; it must not press this again
  });
  window.addEventListener("keydown", (event) => {
    const typing = ["INPUT", "TEXTAREA", "SELECT"].includes(event.target.tagName);
    if (event.code === "KeyB" && !event.repeat && !typing && !event.ctrlKey && !event.metaKey && !event.altKey) mark();
  });
}

/** @param recording {name, problem, megabytes, lost}; an empty name means that nothing is recorded */
export function showRecording(recording) {
  const element = byId("recording");
  const { name = "", problem = "", lost = 0 } = recording ?? {};
  const words = !name ? "Not recorded" : problem || (lost ? `Recording; ${lost} messages lost` : "Recording");
  setText(element, words);
  element.title = name;
  element.classList.toggle("bad", Boolean(problem));
}

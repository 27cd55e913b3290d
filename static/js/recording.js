// What the page says of the recording: that it runs, or in words why not.

import { byId, setText } from "./format.js";

/** @param recording {name, problem, megabytes, lost}; an empty name means that nothing is recorded */
export function showRecording(recording) {
  const element = byId("recording");
  const { name = "", problem = "", lost = 0 } = recording ?? {};
  const words = !name ? "Not recorded" : problem || (lost ? `Recording; ${lost} messages lost` : "Recording");
  setText(element, words);
  element.title = name;
  element.classList.toggle("bad", Boolean(problem));
}

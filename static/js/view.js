// The 3D view's frame. It comes from loopback's other name, and so runs in a process of its own: software rendering
// was measured to hold up a shared one for seconds, which would end every drive and delay every letting go.

import { byId } from "./format.js";

const OTHER_NAME = { "127.0.0.1": "localhost", localhost: "127.0.0.1" };
const ANSWER_MS = 2000;

/** @param on {stop()} */
export function showView(on) {
  const frame = byId("viewer");
  const dark = !matchMedia("(prefers-color-scheme: light)").matches;
  const path = `/viewer/?hideViserLogo${dark ? "&darkMode" : ""}`;
  const other = OTHER_NAME[location.hostname];
  let here = false;

  window.addEventListener("message", (event) => {
    if (event.source !== frame.contentWindow) return;
    if (event.data?.viewer === "here") here = true;
    if (event.data?.viewer === "stop") on.stop();
    if (event.data?.viewer === "done") window.focus();
  });
  if (other) {
    // Should that name lead elsewhere on this machine, the page's own does.
    const fallBack = () => setTimeout(() => {
      if (!here) frame.src = path;
    }, ANSWER_MS);
    frame.addEventListener("load", fallBack, { once: true });
  }
  frame.src = other ? `${location.protocol}//${other}:${location.port}${path}` : path;
}

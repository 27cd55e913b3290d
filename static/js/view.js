// The 3D view's frame. It comes from loopback's other name, and so runs in a process of its own: software rendering
// was measured to hold up a shared one for seconds, which would end every drive and delay every letting go.

import { byId, PLACE } from "./format.js";

const OTHER_NAME = { "127.0.0.1": "localhost", localhost: "127.0.0.1" };
const ANSWER_MS = 2000;

/**
 * @returns {thin(yes)}, which shows the thin view or the full one
 * @param word by which the console knows the views of this page
 * @param thin which of them to begin with
 * @param ticketPath where the view is found under the other name, for which this page's cookie is not valid
 * @param on {stop(), pointerUp(), slow(), told once where the browser draws without graphics hardware}
 */
export function showView(ticketPath, word, thin, on) {
  const frame = byId("viewer");
  const tip = byId("tip-view");
  const dark = !matchMedia("(prefers-color-scheme: light)").matches;
  const query = `?hideViserLogo${dark ? "&darkMode" : ""}`;
  const software = drawnInSoftware();
  if (software) on.slow();
  const detailOf = (yes) => (software ? "plain/" : "") + (yes ? "thin/" : "");
  let detail = detailOf(thin);
  // Behind the #, where viewer_frame.js puts it into the path: so that the browser fetches viser's page only once.
  const source = (view) => `${place}${query}#${word}/${detail}${view}`;
  const other = OTHER_NAME[location.hostname];
  let here = false;
  let place = "";

  window.addEventListener("message", (event) => {
    if (event.source !== frame.contentWindow && event.source !== tip.contentWindow) return;
    if (event.data?.viewer === "here") here = true;
    if (event.data?.viewer === "stop") on.stop();
    if (event.data?.viewer === "up") on.pointerUp();
    if (event.data?.viewer === "done") {
      frame.blur();
      window.focus();
    }
  });
  if (other) {
    // Should that name lead elsewhere on this machine, the page's own does.
    const fallBack = () => setTimeout(() => {
      if (!here) show("viewer/");
    }, ANSWER_MS);
    frame.addEventListener("load", fallBack, { once: true });
  }
  keepTheMouse(frame);
  keepTheMouse(tip);
  const show = (where) => {
    place = where;
    reload(frame, source(""));
    if (!tip.hidden) reload(tip, source("tip/"));
  };
  show(other ? `${location.protocol}//${other}:${location.port}${PLACE}${ticketPath}` : "viewer/");
  const showTip = (yes) => {
    byId("tip-toggle").setAttribute("aria-pressed", yes);
    frame.parentElement.classList.toggle("with-tip", yes);
    tip.hidden = !yes;
    tip.src = yes ? source("tip/") : "about:blank";
  };
  byId("tip-toggle").addEventListener("click", () => showTip(tip.hidden));
  // A second scene drawn in software would starve the rest of the page; there it is shown when asked for.
  showTip(innerWidth > 760 && !thin && !software);
  return {
    thin(yes) {
      detail = detailOf(yes);
      if (yes) showTip(false); // it would take as much again; there it is shown when asked for
      show(place);
    },
  };
}

/** Also where only what is behind the # differs. */
function reload(frame, source) {
  if (!frame.src) {
    frame.src = source;
    return;
  }
  frame.src = "about:blank";
  setTimeout(() => {
    frame.src = source;
  });
}

/**
 * A frame of another process takes the mouse as soon as it is above it, captured or not, and with it the letting go.
 * So it is no target while the mouse is elsewhere on the page, nor while it drags from there.
 */
function keepTheMouse(frame) {
  const away = (yes) => frame.classList.toggle("away", yes);
  window.addEventListener("pointermove", (event) => {
    if (event.pointerType !== "mouse") return;
    if (!event.target.closest?.(".view")) away(true);
    else if (event.buttons === 0) away(false);
  }, true);
  frame.parentElement.addEventListener("pointerdown", (event) => {
    if (event.pointerType !== "mouse") away(false); // fingers stay with the frame they began in
  });
}

function drawnInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl");
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const renderer = gl ? String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER)) : "none";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /none|swiftshader|llvmpipe|software|basic render/i.test(renderer);
}

// Notes, which recordings keep, and the audit trail: who took, drove, stopped and cleared.

import { byId, make, PLACE } from "./format.js";

const REFRESH_MS = 4000;

/** @param ask sends a request: (what, value, text) */
export function notes(ask) {
  byId("note-form").addEventListener("submit", (event) => {
    event.preventDefault();
    ask("mark", null, byId("note").value.trim() || "Marker");
    byId("note").value = "";
    byId("note").blur();
  });
  const trail = byId("trail");
  trail.addEventListener("toggle", showTrail);
  setInterval(() => {
    if (trail.open && !document.hidden && trail.offsetParent) showTrail();
  }, REFRESH_MS);
}

async function showTrail() {
  if (!byId("trail").open) return;
  const deeds = await fetch(`${PLACE}audit`).then((reply) => (reply.ok ? reply.json() : [])).catch(() => []);
  byId("deeds").replaceChildren(...deeds.reverse().slice(0, 60).map(({ time, who, what, detail }) => {
    const at = new Date(time).toLocaleTimeString();
    return make("li", what === "STOP" ? "alarm" : "", `${at} · ${who} ${what}${detail ? `: ${detail}` : ""}`);
  }));
}

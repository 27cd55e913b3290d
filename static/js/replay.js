// The replay's page: play, pause, speed, and a time line with what happened. It asks the replay's own program only.

import { byId, figure, make, PLACE, setText } from "./format.js";
import { TimeLine } from "./timeline.js";
import { stateWord } from "./words.js";

const STEP_S = 5;
let facts = null;
let state = null;
let socket = null;
const line = new TimeLine((t) => act("seek", t));

function act(what, value = 0) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ what, value }));
}

function open() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  socket = new WebSocket(`${scheme}://${location.host}${PLACE}replay`);
  socket.onmessage = (event) => {
    const message = JSON.parse(event.data);
    if (message.type === "facts") showFacts(message);
    else draw(message);
  };
  socket.onopen = () => { byId("lost").hidden = true; };
  socket.onclose = () => {
    byId("lost").hidden = false;
    setTimeout(open, 2000);
  };
}

function showFacts(message) {
  facts = message;
  const [first, other] = facts.recordings;
  document.title = `${first.title} · replay`;
  setText(byId("title"), first.title || "Recording");
  byId("names").replaceChildren(...facts.recordings.map((recording, i) => make("span", i ? "k other" : "", recording.name)));
  byId("no-view").hidden = facts.view;
  if (facts.view && !byId("viewer").src) {
    const dark = !matchMedia("(prefers-color-scheme: light)").matches;
    byId("viewer").src = `viewer/?hideViserLogo${dark ? "&darkMode" : ""}`;
  }
  byId("speed").replaceChildren(...facts.speeds.map((speed) => {
    const option = make("option", "", `${speed} ×`);
    option.value = speed;
    return option;
  }));
  for (const id of ["offset-box", "align", "apart-box"]) byId(id).hidden = !other;
  const warnings = facts.recordings.flatMap((recording) => recording.warnings);
  byId("warnings").replaceChildren(...warnings.map((warning) => make("li", "", warning)));
  setText(byId("events-count"), `${first.events.length}`);
  byId("events").replaceChildren(...first.events.map((event) => {
    const button = make("button", "", make("time", "", clock(event.time_s)), make("span", "", event.text));
    button.type = "button";
    button.addEventListener("click", () => act("seek", event.time_s));
    const item = make("li", event.level, button);
    item.dataset.time = event.time_s;
    return item;
  }));
  if (!first.events.length) byId("events").replaceChildren(make("li", "faint", "none"));
  setText(byId("top-tension"), most(first.overview.tension_N, " N"));
  setText(byId("top-bend"), most(first.overview.bend_deg, "°"));
  line.show(first, other);
}

const most = (values, unit) => (values.some(Number.isFinite) ? ` up to ${Math.max(...values).toFixed(1)}${unit}` : "");

function draw(message) {
  state = message;
  if (!facts) return;
  const [first] = facts.recordings;
  document.body.dataset.phase = state.phase;
  setText(byId("phase"), state.phase ? stateWord(state.phase) : "No state");
  setText(byId("cause"), state.cause);
  setText(byId("driver"), state.driver || "nobody");
  setText(byId("tip"), state.tip_mm ? `${state.tip_mm.map((x) => figure(x, 0, 5)).join(" ")} mm` : "–");
  setText(byId("tension"), `${figure(state.tension, 1, 5)} N`);
  if (state.other) setText(byId("apart"), state.other.apart_mm === null ? "–" : `${figure(state.other.apart_mm, 1, 6)} mm`);
  else setText(byId("apart"), "not there");
  setText(byId("play"), state.playing ? "Pause" : "Play");
  if (document.activeElement !== byId("speed")) byId("speed").value = String(state.speed);
  if (document.activeElement !== byId("offset")) byId("offset").value = -state.offset || 0;
  setText(byId("clock"), `${clock(state.t)} / ${clock(first.duration)}`);
  setText(byId("wall"), new Date(first.started_ms + 1000 * state.t).toLocaleTimeString());
  for (const item of byId("events").children) {
    item.firstChild.classList?.toggle("past", Number(item.dataset.time) <= state.t + 0.05);
  }
  line.shift(state.offset);
  line.cursor(state.t);
}

/** Both begin to drive at the same moment. */
function align() {
  const [first, other] = facts.recordings.map(({ phases }) => phases.find((span) => span.what === "driving")?.start_s ?? 0);
  act("offset", Number((other - first).toFixed(2)));
}

function clock(seconds) {
  const tenths = Math.round(10 * seconds);
  const [hours, minutes, rest] = [Math.floor(tenths / 36000), Math.floor(tenths / 600) % 60, (tenths % 600) / 10];
  const tail = `${String(minutes).padStart(hours ? 2 : 1, "0")}:${rest.toFixed(1).padStart(4, "0")}`;
  return hours ? `${hours}:${tail}` : tail;
}

const toggle = () => act(state?.playing ? "pause" : "play");
const step = (by) => act("seek", (state?.t ?? 0) + by);
byId("play").addEventListener("click", toggle);
byId("back").addEventListener("click", () => step(-STEP_S));
byId("ahead").addEventListener("click", () => step(STEP_S));
byId("speed").addEventListener("change", (event) => {
  act("speed", Number(event.target.value));
  event.target.blur();
});
byId("offset").addEventListener("change", (event) => act("offset", -Number(event.target.value) || 0));
byId("align").addEventListener("click", align);
window.addEventListener("keydown", (event) => {
  if (["INPUT", "SELECT"].includes(event.target.tagName)) return;
  if (event.code === "Space" && event.target.tagName !== "BUTTON") toggle();
  else if (event.code === "ArrowLeft") step(-STEP_S);
  else if (event.code === "ArrowRight") step(STEP_S);
  else if (event.code === "Home") act("seek", 0);
  else return;
  event.preventDefault();
});
open();

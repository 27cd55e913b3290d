// The operator's page: joins the link to the console with the controls and the instruments.

import { Alarms } from "./alarms.js";
import { Authority } from "./authority.js";
import { Commissioning } from "./commissioning.js";
import { Driving } from "./driving.js";
import { byId, figure, PLACE, setAttribute, setList, setProperty, setText } from "./format.js";
import { ChosenPad } from "./gamepad.js";
import { Instruments } from "./instruments.js";
import { listenToKeys } from "./keyboard.js";
import { Link } from "./link.js";
import { Lock } from "./lock.js";
import { choice, Modes, press, speedLabels } from "./modes.js";
import { notes } from "./notes.js";
import { PadPicture } from "./pad.js";
import { PadSetup } from "./pad_setup.js";
import { Plot } from "./plot.js";
import { Tables, tabs } from "./tables.js";
import { Tendons } from "./tendons.js";
import { Thin } from "./thin.js";
import { holdButton, stick } from "./touch.js";
import { showRecording } from "./recording.js";
import { showView } from "./view.js";
import { causeOf, possible, reasonsTitle, REQUESTS, shownPhase, stateWord } from "./words.js";

const ANSWER_MS = 8000;
const FIGURES_MS = 90;
const DRIVERS = ".dock button, .modes .choice button"; // What only somebody who may drive can press.
const instruments = new Instruments();
const pad = new PadPicture(byId("pad-picture"));
const alarms = new Alarms();
const plot = new Plot();
const authority = new Authority((what, value, text) => ask(what, value, text), (who) => {
  const told = state.events.find((event) => event.text.startsWith(`${who} took the controls`));
  alarms.raise(`taken by ${who}`, told?.text ?? `${who} took the controls`);
});
const tables = new Tables();
const lock = new Lock((what) => ask(what));
const commissioning = new Commissioning((what, value, text) => ask(what, value, text));
const tendons = new Tendons((what, value) => ask(what, value));
const modes = new Modes((what, value, text) => ask(what, value, text));

let facts = null;
let state = null;
let waiting = false; // for the browser to draw
let drawnAt = -Infinity;
let answerTimer = 0;

const link = new Link({
  welcome(message) {
    if (!facts) view(message.view);
    facts = message;
    showFacts();
    instruments.welcome(message);
    lock.welcome(message);
    modes.welcome(message);
    commissioning.welcome(message);
  },
  snapshot(message) {
    // What the robot is doing is shown at once; figures that change all the time as often as they can be read.
    const news = message.phase !== state?.phase || message.driver !== state?.driver || message.cause !== state?.cause;
    state = message;
    plot.take(message);
    // Where pictures come late, the news must be in the next one that comes, so it does not wait for a frame of its own.
    if (news) return draw();
    if (waiting || performance.now() - drawnAt <= FIGURES_MS) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      draw();
    });
  },
  connected(yes) {
    enableDriving();
    // What was held before the line broke must be let go and pressed anew.
    if (!yes) {
      driving.end();
      if (facts) alarms.raise("offline", "The connection to the console was lost.");
    }
    draw();
  },
});

let picture = null; // the 3D view
const thin = new Thin(link, {
  change: (yes) => picture?.thin(yes),
  slow: () => showAnswer("The link does not carry the full view: this is the thin one, with less detail. Thin view switches back."),
});

const sticks = {};
const driving = new Driving(
  (reading) => facts && facts.role !== "viewer" && link.controls(reading),
  (reading) => {
    const twists = reading.buttons.includes("right_shoulder");
    sticks.left?.(reading.left);
    sticks.right?.(twists ? [0, 0] : reading.right);
    byId("hold").classList.toggle("held", reading.held);
    document.body.classList.toggle("held", reading.held);
    for (const [id, on] of [
      ["twist-left", twists && reading.right[0] < 0], ["twist-right", twists && reading.right[0] > 0],
      ["feed-in", reading.rt > 0], ["feed-out", reading.lt > 0],
    ]) byId(id).classList.toggle("active", Boolean(on));
  },
);

// ---------------------------------------------------------------- asking

async function ask(what, value = null, text = "") {
  const answer = await link.act(what, value, text);
  const reasons = answer.reasons.join("; ");
  const refused = what === "stop" ? "STOP may not have worked" : `${REQUESTS[what]} refused`;
  showAnswer(answer.ok ? reasons : `${refused}: ${reasons || "no reason given"}`);
}

/** STOP goes two ways at once, in case one of them is dead without knowing it. */
function stop() {
  ask("stop");
  const way = `${PLACE}stop?page=${link.page.replace(/\D/g, "")}&press=${link.requestId}`;
  fetch(way, { method: "POST", keepalive: true }).catch(() => {
    if (!link.connected) showAnswer("STOP did not reach the console. The robot holds when its driver is lost.");
  });
  driving.end();
}

function showAnswer(text) {
  clearTimeout(answerTimer);
  setText(byId("answer"), text);
  byId("answer").hidden = !text;
  if (text) answerTimer = setTimeout(() => showAnswer(""), ANSWER_MS);
}

for (const what of ["arm", "disarm", "home", "clear"]) byId(what).addEventListener("click", () => ask(what));
byId("restart-robot").addEventListener("click", () => ask("restart_robot"));

// At the first touch, not at the click that may follow it.
byId("stop").addEventListener("pointerdown", stop);
byId("stop").addEventListener("click", (event) => {
  if (event.detail === 0) stop(); // from a screen reader, which points with nothing
});
byId("stop").addEventListener("keydown", (event) => {
  if (event.code !== "Enter" && event.code !== "Space") return;
  event.preventDefault();
  event.stopPropagation(); // here the space bar stops, it does not drive
  if (!event.repeat) stop();
});

// A dialog takes every click: one on STOP is a STOP all the same, as the button is still to be seen.
for (const dialog of document.querySelectorAll("dialog")) {
  dialog.addEventListener("pointerdown", (event) => {
    const { left, right, top, bottom } = byId("stop").getBoundingClientRect();
    const there = event.clientX >= left && event.clientX <= right && event.clientY >= top && event.clientY <= bottom;
    if (event.target === dialog && there) stop();
  });
}

byId("quit").addEventListener("click", () => {
  driving.end();
  byId("quit-dialog").showModal();
});
byId("quit-dialog").addEventListener("close", (event) => {
  if (event.target.returnValue === "quit") ask("quit");
  event.target.returnValue = "";
  document.activeElement?.blur();
});

// ---------------------------------------------------------------- driving

let settingUp = false;

function enableDriving() {
  driving.enabled = link.connected && facts?.role !== "viewer" && !settingUp;
}

const chosenPad = new ChosenPad({
  stop,
  lost(name) {
    driving.end();
    if (name) showAnswer(`${name} is gone. Whatever it drove has ended; choose a pad again under Pad.`);
  },
});
driving.pad = chosenPad;

let padOfConsole = false; // whether the console's pad drove before it was set up
const padSetup = new PadSetup(chosenPad, {
  ask,
  state: () => state,
  opened(device) {
    settingUp = true;
    driving.end();
    enableDriving();
    padOfConsole = device.at === "console" && state.seat.console_pad;
    if (padOfConsole) ask("console_pad", 0);
  },
  closed() {
    settingUp = false;
    enableDriving();
    if (padOfConsole) ask("console_pad", 1);
  },
});

sticks.left = stick("stick-left", driving);
sticks.right = stick("stick-right", driving);
for (const id of ["hold", "twist-left", "twist-right", "feed-in", "feed-out"]) holdButton(id, driving);

listenToKeys(driving, {
  stop,
  section: (index) => {
    if (!facts || !state) return;
    if (state.mode === "pose") modes.pose(index);
    else if (index < facts.bending.length) ask("section", facts.bending[index]);
  },
  next: (what) => modes.next(what),
  tip: () => byId("tip-toggle").click(),
  note: () => {
    byId("tab-events").click();
    byId("note").focus();
  },
  acknowledge: () => alarms.acknowledge(),
  speed: (step) => {
    if (!facts || !state) return;
    const index = Math.min(facts.speed_levels.length - 1, Math.max(0, state.speed + step));
    if (index !== state.speed) ask("speed", index);
  },
});

// A page that is not looked at does not drive.
window.addEventListener("blur", () => driving.end());
window.addEventListener("pagehide", () => driving.end());
document.addEventListener("visibilitychange", () => {
  if (document.hidden) driving.end();
});

function view(ticketPath) {
  picture = showView(ticketPath, link.view, thin.yes, {
    stop,
    slow: () => showAnswer("This browser draws the 3D view without graphics hardware: plainly, and a few pictures a second."),
    // A letting go that was meant for a control of this page but went to the 3D view.
    pointerUp: () => {
      if (driving.pressed.size > 0) driving.end();
    },
  });
}

// ---------------------------------------------------------------- showing

function showFacts() {
  document.title = `${facts.title} · cobra-teleop`;
  setText(byId("title"), facts.title);
  byId("title").title = facts.summary ?? "";
  const versions = Object.entries(facts.versions).map(([name, version]) => `${name} ${version}`);
  setText(byId("versions"), versions[0] ?? "");
  byId("versions").title = versions.join("\n");
  document.body.dataset.role = facts.role;
  if (facts.elsewhere) {
    setText(byId("quit-title"), "End this console?");
    setText(byId("quit-text"), "The robot holds, and its process goes on where it runs. Everybody who watches here is cut off.");
  }
  // A watched robot's page is one of many, under the wall.
  byId("to-wall").hidden = PLACE === "/";
  byId("versions").hidden = PLACE !== "/";
  setText(byId("user"), `${facts.user}, ${facts.role}`);
  byId("danger").hidden = !facts.danger;
  setText(byId("danger"), facts.danger);
  const bending = facts.bending.map((i) => facts.sections[i]);
  byId("sections").replaceChildren(...choice("section", bending, (i) => ask("section", facts.bending[i])));
  byId("speeds").replaceChildren(...choice("speed", speedLabels(facts.speed_levels), (i) => ask("speed", i)));
}

function draw() {
  drawnAt = performance.now();
  const phase = shownPhase(state, link.connected);
  setAttribute(document.body, "data-phase", phase);
  setText(byId("state"), stateWord(phase));
  const may = Boolean(state && facts) && authority.show(state, facts, link.page, link.connected);
  setText(byId("cause"), causeOf(phase, state, may));
  showNotice(phase);
  showButtons(phase);
  showQuality();
  if (!state || !facts) return;
  document.body.classList.toggle("drives-not", !may);
  alarms.snapshot(state);
  plot.show();
  showWho(phase);
  press("sections", facts.bending.indexOf(state.section));
  press("speeds", state.speed);
  modes.snapshot(state);
  instruments.snapshot(state);
  lock.snapshot(state, phase);
  commissioning.snapshot(state, phase);
  tendons.snapshot(state.tendons, phase);
  tables.snapshot(state);
  showRecording(state.recording);
  pad.show(state.pad, driving.reading(), chosenPad.id, state.hints?.[chosenPad.id ? link.page : "pad"]);
}

function showQuality() {
  setText(byId("page-link"), link.connected ? link.quality.text() : "cut off");
  const [level, words] = link.connected ? link.quality.verdict(link.age(), facts?.role !== "viewer" && driving.enabled, state?.link.trip_ms ?? 0) : ["", ""];
  setAttribute(byId("page-link"), "data-level", level);
  setProperty(byId("page-link"), "title", `Round trip and its change; ${link.quality.lost} answers late or lost`);
  setProperty(byId("slow"), "hidden", !words);
  setText(byId("slow"), words);
}

function showWho(phase) {
  setText(byId("driver"), state.lease.holder || "nobody");
  setProperty(byId("sign-out"), "hidden", state.seat.shared); // nobody signed in here
  setProperty(byId("driver"), "title", state.lease.holder);
  const input = { "": "none", [link.page]: "this page" }[state.driver] ?? state.driver;
  setText(byId("input"), input);
  const age = state.link.robot ? `${figure(state.link.age_ms)} ms` : "gone";
  setText(byId("robot-link"), phase === "offline" ? "unknown" : age);
}

function showNotice(phase) {
  const cut = ["offline", "gone", "silent"].includes(phase);
  setProperty(byId("notice"), "hidden", !cut);
  setProperty(byId("restart-robot"), "hidden", phase !== "gone" || Boolean(facts?.elsewhere));
  if (!cut) return;
  setText(byId("notice-title"), stateWord(phase));
  setText(byId("notice-text"), causeOf(phase, state));
}

function showButtons(phase) {
  const reasons = phase in { offline: 1, gone: 1, silent: 1 } || !state ? [] : state.reasons;
  const can = possible(phase, reasons);
  for (const what of ["arm", "disarm", "home", "clear"]) setProperty(byId(what), "disabled", !can[what]);
  setText(byId("reasons-title"), reasonsTitle(phase, reasons));
  setList(byId("reasons"), reasons);
  setList(byId("latest"), reasons.length || !state ? [] : state.events.slice(0, 3).map((event) => [event.level, event.text]));
  const off = !link.connected || facts?.role === "viewer";
  for (const button of document.querySelectorAll(DRIVERS)) setProperty(button, "disabled", off);
  setProperty(byId("quit"), "hidden", facts?.role !== "admin");
  setProperty(byId("quit"), "disabled", off);
  document.querySelector(".dock").classList.toggle("off", off);
  const drives = phase === "driving" && state.driver === link.page;
  setText(byId("hold-word"), driving.held ? (drives ? "Driving" : "Held") : "Hold to drive");
  // What is missing for this page to drive is said where it is tried.
  const hint = state?.hints?.[link.page] ?? "";
  setText(byId("hold-hint"), off || drives || phase === "ready" && !driving.held || !hint ? "Space" : hint);
}

notes(ask);
tabs();

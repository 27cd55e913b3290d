// The wall: every robot's state, driver and alarms at a glance; a click opens its page, STOP is on every tile.

import { ago, byId, figure, make, setList, setText } from "./format.js";
import { shownPhase, stateWord } from "./words.js";

const WORDS = {
  offline: "No connection to the console.",
  gone: "Its process has ended, or cannot be reached.",
  silent: "Its state does not arrive. What is shown is old.",
};
const STALE_MS = 1500;
const RETRY_MS = 1000;
const tiles = new Map();
let heard = -Infinity;
let newest = null;

function open() {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/wall`);
  socket.binaryType = "arraybuffer";
  socket.onmessage = (event) => {
    newest = JSON.parse(new TextDecoder().decode(event.data));
    heard = performance.now();
    socket.send("seen"); // who does not say so is taken for one who does not read
    draw();
  };
  socket.onclose = () => setTimeout(open, RETRY_MS);
}

function draw() {
  const connected = performance.now() - heard < STALE_MS;
  document.body.dataset.phase = connected ? "" : "offline";
  if (!newest) return;
  const robots = newest.robots;
  const driven = robots.filter((robot) => robot.driver).length;
  setText(byId("summary"), connected
    ? `${robots.length} ${robots.length === 1 ? "robot" : "robots"}, ${driven} driven`
    : "Cut off from the console. What is shown is old.");
  setList(byId("troubles"), newest.troubles);
  for (const robot of robots) tileOf(robot.name)(robot, connected);
}

/** The function that shows a robot on its tile; the tile is made when the robot is first heard of. */
function tileOf(name) {
  const known = tiles.get(name);
  if (known) return known;
  const link = make("a", "", name);
  link.href = `/robot/${encodeURIComponent(name)}/`;
  const button = make("button", "stop", "STOP");
  button.type = "button";
  button.setAttribute("aria-label", `STOP ${name}`);
  button.addEventListener("click", () => stop(name));
  const state = make("strong", "state");
  const cause = make("p", "cause");
  const alarm = make("p", "alarm");
  const facts = ["Driver", "Feed", "Tension", "Age"].map((label) => [label, make("dd")]);
  const list = make("dl", "", ...facts.map(([label, value]) => make("div", "", make("dt", "", label), value)));
  const tile = make("section", "tile", link, button, state, cause, list, alarm);
  tile.dataset.testid = `robot-${name}`;
  const after = [...byId("wall").children].find((other) => other.dataset.testid > tile.dataset.testid);
  byId("wall").insertBefore(tile, after ?? null);

  const show = (robot, connected) => {
    const phase = shownPhase({ phase: robot.phase, link: { robot: robot.present, ok: robot.fresh } }, connected);
    tile.dataset.phase = phase;
    setText(state, stateWord(phase));
    setText(cause, WORDS[phase] ?? robot.cause);
    const unit = (value, name) => (value === null ? figure(NaN) : `${figure(value)} ${name}`);
    const texts = [
      robot.driver || "nobody", unit(robot.feed_mm, "mm"), unit(robot.tension_N, "N"), ago(robot.age_s ?? NaN),
    ];
    facts.forEach(([, value], i) => setText(value, texts[i]));
    const more = robot.alarms > 1 ? ` (${robot.alarms} in 10 min)` : "";
    setText(alarm, robot.alarm ? `${robot.alarm.text} · ${ago(robot.alarm.ago)} ago${more}` : "");
  };
  tiles.set(name, show);
  return show;
}

async function stop(name) {
  try {
    const answer = await fetch(`/robot/${encodeURIComponent(name)}/stop`, { method: "POST" });
    if (!answer.ok) throw new Error(await answer.text());
    const { reasons } = await answer.json();
    if (reasons.length) throw new Error(reasons.join("; "));
    say("");
  } catch (error) {
    say(`STOP of ${name} did not get through: ${error.message}`);
  }
}

function say(text) {
  setText(byId("answer"), text);
  byId("answer").hidden = !text;
}

setInterval(draw, 500);
open();

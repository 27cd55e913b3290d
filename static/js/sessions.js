// The catalogue: what was recorded, searched as it is typed; marks, notes, downloads, deletions.

import { byId, make, setText } from "./format.js";

const ANSWER_MS = 8000;
const REFRESH_MS = 10000;
let may = {};
let timer = 0;
let asked = 0;

async function refresh() {
  const number = ++asked;
  const answer = await fetch(`sessions/list?${new URLSearchParams(new FormData(byId("search")))}`).catch(() => null);
  if (number !== asked) return;
  if (!answer?.ok) {
    say(answer ? (await answer.json()).reasons.join("; ") : "The console does not answer.");
    return;
  }
  const found = await answer.json();
  may = found.may;
  setText(byId("folder"), found.folder);
  byId("none").hidden = found.sessions.length > 0;
  const { activeElement: held } = document;
  const within = byId("rows").contains(held);
  if (within && held.tagName === "INPUT") return; // a note that is being written is not taken away under the hand
  const [name, what] = within ? [held.closest("tr").dataset.name, held.dataset.what] : [];
  byId("rows").replaceChildren(...found.sessions.map(row));
  for (const line of byId("rows").children) {
    if (line.dataset.name === name) line.querySelector(`[data-what="${what}"]`)?.focus();
  }
}

function row(session) {
  const star = make("button", "star", session.marked ? "★" : "☆");
  star.type = "button";
  star.disabled = !may.change;
  star.setAttribute("aria-pressed", session.marked);
  star.title = session.marked ? "Kept for good" : "May be deleted to make room; click to keep it for good";
  star.setAttribute("aria-label", `keep ${session.name} for good`);
  star.dataset.what = "star";
  star.addEventListener("click", () => change(session.name, { marked: !session.marked }));

  const note = make("input");
  note.value = session.note;
  note.disabled = !may.change;
  note.maxLength = 2000;
  note.setAttribute("aria-label", `note to ${session.name}`);
  note.addEventListener("change", () => change(session.name, { note: note.value }));
  note.addEventListener("keydown", (event) => { if (event.key === "Enter") note.blur(); });

  const acts = [link("Download", `sessions/file/${encodeURIComponent(session.name)}`)];
  for (const frames of session.frames) {
    acts.push(link("CAN", `sessions/frames/${encodeURIComponent(session.name)}/${encodeURIComponent(frames)}`));
    acts.at(-1).title = `Raw CAN frames: ${frames}`;
  }
  const remove = make("button", "quiet", "Delete");
  remove.type = "button";
  remove.dataset.what = "delete";
  remove.disabled = !may.delete || session.marked || session.status === "recording";
  if (session.marked) remove.title = "Kept for good: take its star away first";
  remove.addEventListener("click", () => ask(session));

  const when = session.started ? new Date(session.started).toLocaleString() : session.status;
  const name = make("td", "name", when, make("small", "", session.name));
  const alarms = make("td", "alarms", session.alarms.length ? `${session.alarms.length}: ${session.alarms[0]}` : "");
  alarms.title = session.alarms.join("\n");
  const length = session.duration_s === null ? session.status : clock(session.duration_s);
  const line = make("tr", "", make("td", "", star), name, make("td", "", length),
    make("td", "", session.title || session.robot), make("td", "", session.drivers.join(", ")), alarms,
    make("td", "", `${session.megabytes.toFixed(1)} MB`), make("td", "", note), make("td", "acts", ...acts, remove));
  line.dataset.name = session.name;
  return line;
}

function link(words, href) {
  const element = make("a", "", words);
  element.href = href;
  return element;
}

async function post(path, body = {}) {
  const answer = await fetch(path, { method: "POST", body: JSON.stringify(body) }).catch(() => null);
  if (!answer) say("The console does not answer.");
  else if (!answer.ok) say((await answer.json()).reasons.join("; "));
  await refresh();
}

const change = (name, wanted) => post(`sessions/change/${encodeURIComponent(name)}`, wanted);

function ask(session) {
  const sure = byId("sure");
  setText(byId("sure-text"), `${session.name}, ${session.megabytes.toFixed(1)} MB, with its notes. It cannot be brought back.`);
  sure.returnValue = "";
  sure.onclose = () => {
    if (sure.returnValue === "delete") post(`sessions/delete/${encodeURIComponent(session.name)}`);
  };
  sure.showModal();
}

function say(text) {
  clearTimeout(timer);
  setText(byId("answer"), text);
  byId("answer").hidden = false;
  timer = setTimeout(() => { byId("answer").hidden = true; }, ANSWER_MS);
}

function clock(seconds) {
  const whole = Math.round(seconds);
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  return `${h ? `${h}:` : ""}${String(m).padStart(h ? 2 : 1, "0")}:${String(s).padStart(2, "0")}`;
}

byId("search").addEventListener("input", refresh);
byId("search").addEventListener("submit", (event) => event.preventDefault());
setInterval(refresh, REFRESH_MS);
refresh();

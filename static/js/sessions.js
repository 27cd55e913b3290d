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
  // A note that is being written is not taken away under the hand.
  if (!byId("rows").contains(document.activeElement)) byId("rows").replaceChildren(...found.sessions.map(row));
}

function row(session) {
  const star = make("button", "star", session.marked ? "★" : "☆");
  star.type = "button";
  star.disabled = !may.mark;
  star.setAttribute("aria-pressed", session.marked);
  star.setAttribute("aria-label", session.marked ? "kept for good" : "may be deleted to make room");
  star.addEventListener("click", () => change(session.name, { marked: !session.marked }));

  const note = make("input");
  note.value = session.note;
  note.disabled = !may.note;
  note.maxLength = 2000;
  note.setAttribute("aria-label", `note to ${session.name}`);
  note.addEventListener("change", () => change(session.name, { note: note.value }));
  note.addEventListener("keydown", (event) => { if (event.key === "Enter") note.blur(); });

  const file = make("a", "", "Download");
  file.href = `sessions/file/${encodeURIComponent(session.name)}`;
  const remove = make("button", "quiet", "Delete");
  remove.type = "button";
  remove.disabled = !may.delete || session.marked || session.status === "recording";
  remove.addEventListener("click", () => ask(session));

  const when = session.started ? new Date(session.started).toLocaleString() : session.status;
  const name = make("td", "name", when, make("small", "", session.name));
  const alarms = make("td", "alarms", session.alarms.length ? `${session.alarms.length}: ${session.alarms[0]}` : "");
  alarms.title = session.alarms.join("\n");
  const length = session.duration_s === null ? session.status : clock(session.duration_s);
  const line = make("tr", "", make("td", "", star), name, make("td", "", length),
    make("td", "", session.title || session.robot), make("td", "", session.drivers.join(", ")), alarms,
    make("td", "", `${session.megabytes.toFixed(1)} MB`), make("td", "", note), make("td", "acts", file, remove));
  line.dataset.name = session.name;
  return line;
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

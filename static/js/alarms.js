// Alarms latch: what went wrong stays on the page, and sounds, until somebody says that they have seen it.

import { byId, make } from "./format.js";

const BEEP_EVERY_MS = 1500;
const MOST = 5;

export class Alarms {
  constructor() {
    this.alarms = new Map(); // key → text
    this.seen = new Set();
    this.first = true;
    this.audio = null;
    this.silent = recall("silent") === "yes";
    byId("acknowledge").addEventListener("click", () => this.acknowledge());
    byId("sound").addEventListener("click", () => {
      this.silent = !this.silent;
      keep("silent", this.silent ? "yes" : "no");
      this.#showSound();
    });
    this.#showSound();
    // Browsers let a page sound only after somebody has touched it.
    for (const kind of ["pointerdown", "keydown"]) window.addEventListener(kind, () => this.#wakeAudio(), { capture: true });
    setInterval(() => this.#beep(), BEEP_EVERY_MS);
    // What else lies over the 3D view begins below them.
    new ResizeObserver(([box]) => {
      const height = box.borderBoxSize[0].blockSize;
      byId("alarms").parentElement.style.setProperty("--alarms", `${height ? height + 10 : 0}px`);
    }).observe(byId("alarms"), { box: "border-box" });
  }

  /** Take the alarms among the robot's events; those from before this page was opened are history. */
  snapshot(state) {
    for (const event of state.events) {
      const key = `${event.stamp} ${event.text}`;
      if (event.level !== "alarm" || this.seen.has(key)) continue;
      this.seen.add(key);
      if (!this.first) this.raise(key, event.text);
    }
    this.first = false;
  }

  raise(key, text) {
    this.alarms.set(key, text);
    this.#show();
    this.#beep();
  }

  acknowledge() {
    this.alarms.clear();
    this.#show();
  }

  #show() {
    const texts = [...this.alarms.values()];
    byId("alarms").hidden = texts.length === 0;
    byId("alarm-list").replaceChildren(...texts.slice(-MOST).map((text) => make("li", "", text)));
    document.body.classList.toggle("alarmed", texts.length > 0);
  }

  #showSound() {
    byId("sound").textContent = this.silent ? "Sound off" : "Sound on";
    byId("sound").setAttribute("aria-pressed", !this.silent);
  }

  #wakeAudio() {
    this.audio ??= new AudioContext();
    if (this.audio.state === "suspended") this.audio.resume();
  }

  #beep() {
    if (!this.alarms.size || this.silent || this.audio?.state !== "running") return;
    const [tone, volume] = [this.audio.createOscillator(), this.audio.createGain()];
    const now = this.audio.currentTime;
    tone.frequency.setValueAtTime(880, now);
    tone.frequency.setValueAtTime(660, now + 0.15);
    volume.gain.setValueAtTime(0.12, now);
    volume.gain.exponentialRampToValueAtTime(0.001, now + 0.4);
    tone.connect(volume).connect(this.audio.destination);
    tone.start(now);
    tone.stop(now + 0.4);
  }
}

function recall(name) {
  try {
    return localStorage.getItem(name);
  } catch {
    return null;
  }
}

function keep(name, value) {
  try {
    localStorage.setItem(name, value);
  } catch {
    // without storage the choice lasts as long as the page
  }
}

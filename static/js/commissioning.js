// Commissioning, one step at a time: who answers, which is which, does each do what is described, load cells, homing.
// It lies over the 3D view only: STOP and all else stay in reach.

import { byId, DASH, figure, make, setList, setText } from "./format.js";

const STANDS = ["disarmed", "fault", "ready", "holding"];
const RUNS = 3;
const ENDED = { done: "Done.", ended: "Ended before it was done." };

/** What each step is for; `ran` is the request whose findings it shows. */
const STEPS = [
  { key: "motors", title: "Motors", ran: "", text: "Every described drive should answer, with its supply and without an error." },
  { key: "identify", title: "Which is which", ran: "identify", text: "Press a drive and look at the robot: that motor moves to and fro by five degrees. A tendon is paid out, never pulled." },
  { key: "test", title: "Test", ran: "test", text: "Each drive goes out a little, comes in until its tendon pulls, and goes back. Encoder, direction and current are checked." },
  { key: "cells", title: "Load cells", ran: "tare", text: "Tare first: the tendons are slackened, and what the cells read then is nothing. Then hang a known weight on a tendon and say its force." },
  { key: "home", title: "Homing", ran: "home_repeatedly", text: "Tendons are slackened, wound to contact and tightened together, three times. The zeros of the three should agree to half a millimetre." },
  { key: "end", title: "Done", ran: "", text: "The zeros and tares are kept with their date and are used from now on." },
];

export class Commissioning {
  /** @param ask sends a request: (what, value, text) */
  constructor(ask) {
    this.ask = ask;
    this.facts = null;
    this.state = null;
    this.at = 0;
    this.open = make("button", "commission-open", "Commission…");
    this.open.type = "button";
    this.open.dataset.testid = "commission-open";
    this.open.addEventListener("click", () => this.#show(true));
    byId("panel-drives").prepend(this.open);
    this.panel = this.#build();
    document.querySelector(".view").append(this.panel);
  }

  welcome(facts) {
    this.facts = facts;
    this.open.hidden = facts.role === "viewer";
    if (facts.role === "viewer") this.#show(false);
  }

  snapshot(state, phase) {
    this.state = state;
    this.phase = phase;
    if (!this.panel.hidden) this.#draw();
  }

  // ------------------------------------------------------------------ building

  #build() {
    const button = (text, id, act, className = "") => {
      const element = make("button", className, text);
      element.type = "button";
      element.dataset.testid = id;
      element.addEventListener("click", act);
      return element;
    };
    this.title = make("h2");
    this.count = make("span", "faint");
    this.text = make("p", "commission-text");
    this.busy = make("p", "commission-busy");
    this.busy.setAttribute("role", "status");
    this.found = make("ul", "commission-found");
    this.found.dataset.testid = "commission-found";
    this.bodies = {
      motors: make("ul", "commission-found"),
      identify: make("div", "commission-drives"),
      test: make("div", "commission-row"),
      cells: make("div"),
      home: make("div", "commission-row"),
      end: make("p"),
    };
    this.bodies.motors.dataset.testid = "commission-motors";
    this.bodies.test.append(button("Test all drives", "commission-test", () => this.ask("test"), "primary"));
    this.bodies.home.append(
      button("Home three times", "commission-home", () => this.ask("home_repeatedly", RUNS), "primary"),
      button("Take the kept zeros", "commission-resume", () => this.ask("resume")),
      make("span", "faint", "Kept zeros hold only while the drives had power all the time."),
    );
    this.cells = make("ul", "commission-found");
    this.tendon = make("select");
    this.tendon.setAttribute("aria-label", "Tendon");
    this.force = make("input");
    Object.assign(this.force, { inputMode: "decimal", placeholder: "force", maxLength: 8, size: 6, autocomplete: "off" });
    this.force.setAttribute("aria-label", "Force in newtons");
    this.bodies.cells.append(
      this.cells,
      make(
        "div", "commission-row",
        button("Slacken and tare", "commission-tare", () => this.ask("tare"), "primary"),
        this.tendon, this.force, make("span", "", "N"),
        button("Take this force", "commission-force", () => this.ask("calibrate_cell", null, `${this.tendon.value} ${this.force.value}`)),
      ),
    );
    this.back = button("Back", "commission-back", () => this.#go(-1));
    this.next = button("Next", "commission-next", () => this.#go(1), "primary");
    this.end = button("End this step", "commission-abort", () => this.ask("abort"), "danger");
    this.off = button("Switch the drives off", "commission-off", () => this.ask("disarm"));
    const close = button("Close", "commission-close", () => this.#show(false), "quiet");
    const panel = make(
      "section", "commission",
      make("header", "", this.title, this.count, close), this.text,
      ...Object.values(this.bodies), this.busy, this.found,
      make("footer", "", this.end, this.off, make("span", "space"), this.back, this.next),
    );
    panel.setAttribute("aria-label", "Commissioning");
    panel.dataset.testid = "commission";
    panel.hidden = true;
    return panel;
  }

  // ------------------------------------------------------------------ moving on

  get steps() {
    const cells = this.state?.commissioning?.cells.length;
    return STEPS.filter((step) => step.key !== "cells" || cells);
  }

  #show(yes) {
    this.panel.hidden = !yes;
    if (yes && this.state) this.#draw();
  }

  #go(by) {
    this.at = Math.max(0, Math.min(this.steps.length - 1, this.at + by));
    this.#draw();
  }

  // ------------------------------------------------------------------ showing

  #draw() {
    const state = this.state;
    const now = state.commissioning;
    if (!now) return;
    const step = this.steps[Math.min(this.at, this.steps.length - 1)];
    const running = now.outcome === "running";
    const stands = STANDS.includes(this.phase) && !running;
    setText(this.title, step.title);
    setText(this.count, `step ${this.steps.indexOf(step) + 1} of ${this.steps.length}`);
    setText(this.text, step.text);
    for (const [key, body] of Object.entries(this.bodies)) {
      body.hidden = key !== step.key;
      for (const button of body.querySelectorAll("button")) button.disabled = !stands;
    }
    this.#fill(step.key, state, now);
    const own = [step.ran, step.key === "cells" ? "calibrate_cell" : ""].includes(now.step) && now.step;
    setText(this.busy, own ? this.#words(now, running) : this.#blocked(running, stands));
    this.busy.dataset.level = own && now.outcome === "ended" ? "bad" : "";
    setList(this.found, own && !running || step.key === "test" && own ? rows(now.found) : []);
    this.end.hidden = !running;
    this.off.hidden = running || !["ready", "holding"].includes(this.phase);
    this.back.disabled = running || this.at === 0;
    this.next.disabled = running || this.at >= this.steps.length - 1;
  }

  #fill(key, state, now) {
    if (key === "motors") {
      setList(this.bodies.motors, state.drives.map((drive) => {
        const wrong = drive.fault || (drive.age_ms === null ? "does not answer: check power, cable and address" : drive.warning);
        const told = `${figure(drive.temperature)} °C · ${figure(drive.voltage, 1)} V`;
        return [wrong ? "bad" : "good", `${drive.name} — ${wrong || `answers · ${told}`}`];
      }));
    } else if (key === "identify") {
      this.#drives(state.drives);
    } else if (key === "cells") {
      setList(this.cells, now.cells.map((cell) => {
        const value = cell.tension === null ? DASH : `${figure(cell.tension, 2)} N`;
        return [cell.trouble ? "bad" : "good", `${cell.tendon} — ${cell.trouble || value} (reads ${figure(cell.reading, 2)} N)`];
      }));
      const names = now.cells.map((cell) => cell.tendon);
      if (this.tendon.length !== names.length) this.tendon.replaceChildren(...names.map((name) => make("option", "", name)));
    } else if (key === "end") {
      setText(this.bodies.end, now.calibration ? `In use: ${now.calibration}` : "Nothing is kept yet: home the robot first.");
    }
  }

  #drives(drives) {
    const list = this.bodies.identify;
    if (list.childElementCount === drives.length) return;
    list.replaceChildren(...drives.map(({ name }) => {
      const button = make("button", "", name);
      button.type = "button";
      button.dataset.testid = `identify-${name}`;
      button.addEventListener("click", () => this.ask("identify", null, name));
      return button;
    }));
  }

  #words(now, running) {
    if (running) return now.doing ? `${now.doing.charAt(0).toUpperCase()}${now.doing.slice(1)} …` : "Begins …";
    if (now.outcome === "ended") return `${ENDED.ended} ${now.words.charAt(0).toUpperCase()}${now.words.slice(1).replace(/\.$/, "")}.`;
    const wrong = now.found.filter((found) => !found.ok).length;
    if (wrong) return `Done; ${wrong} of ${now.found.length} not as described.`;
    return now.found.length ? `${ENDED.done} All as it should be.` : "";
  }

  #blocked(running, stands) {
    if (running) return "Another step runs.";
    if (stands) return "";
    return this.phase === "stopped" ? "STOP is latched: clear it first." : "Wait until the robot stands.";
  }
}

function rows(found) {
  return found.map(({ drive, check, ok, words }) => [ok ? "good" : "bad", `${drive} · ${check} — ${words}`]);
}

// Choosing the pad that drives, and setting it up: a live picture, a test without effect, calibration, shape, assignment.
// Nothing of it takes effect before Apply, and the console applies it only while the robot is disarmed.

import { AS_BUILT, corrected, padsHere, rawReading } from "./gamepad.js";
import { byId, make, PLACE, setText } from "./format.js";
import { PadPicture } from "./pad.js";

const LOOK_MS = 500;
const SAMPLE_MS = 10; // Not with the browser's frames: where it draws in software they miss most of a stick's way.
const REST_MS = 1000;
const SWEEP_MS = 5000;
const AXES = { left_x: "left stick, left/right", left_y: "left stick, up/down", right_x: "right stick, left/right", right_y: "right stick, up/down" };
const BUTTONS = ["a", "b", "x", "y", "back", "start", "left_shoulder", "right_shoulder", "left_stick", "right_stick", "dpad_up", "dpad_down", "dpad_left", "dpad_right"];

export class PadSetup {
  /** @param chosen the `ChosenPad`; `on` {ask(what, value), state(), opened(), closed()} */
  constructor(chosen, on) {
    this.chosen = chosen;
    this.on = on;
    this.profiles = {};
    this.device = null;
    this.listed = "";
    this.picture = new PadPicture(byId("setup-picture"));
    this.draft = structuredClone(AS_BUILT);
    this.calibrating = null;
    this.#load();
    this.#form();
    setInterval(() => this.#list(), LOOK_MS);
    setInterval(() => this.#calibrate(), SAMPLE_MS);
  }

  #load() {
    return fetch(`${PLACE}pads`).then((reply) => (reply.ok ? reply.json() : {})).then((profiles) => {
      this.profiles = profiles;
    }).catch(() => {});
  }

  profileOf(id) {
    return { ...AS_BUILT, ...this.profiles[id.slice(0, 160)] };
  }

  /** The pads there are, with what can be done with each. */
  #list() {
    const pads = padsHere();
    const { pad: own, seat } = this.on.state() ?? { pad: { name: "" }, seat: { shared: true, console_pad: true } };
    const key = JSON.stringify([pads?.map((pad) => [pad.index, pad.id, pad.mapping]), own.name, own.connected, seat, this.chosen.index]);
    if (key === this.listed) return;
    this.listed = key;
    const rows = [];
    if (own.name) {
      rows.push(this.#row(`${own.name}, at the console`, seat.console_pad, (yes) => this.on.ask("console_pad", yes ? 1 : 0), { id: own.name, at: "console" }));
    }
    for (const pad of pads ?? []) {
      if (pad.mapping !== "standard") rows.push(make("li", "", `${pad.id}: its layout is not known to the browser; it cannot drive.`));
      else rows.push(this.#row(pad.id, pad.index === this.chosen.index, (yes) => this.#choose(yes ? pad : null), { id: pad.id, index: pad.index, at: "here" }));
    }
    if (pads === null) rows.push(make("li", "", "The browser shows pads only to pages served with TLS or from this computer."));
    else if (!pads.length) rows.push(make("li", "", "A pad of this computer shows here once one of its buttons is pressed."));
    byId("pad-list").replaceChildren(...rows);
  }

  #row(name, drives, choose, device) {
    const button = make("button", drives ? "" : "primary", drives ? "Stop using it" : "Drive with this pad");
    button.type = "button";
    button.dataset.testid = `pad-use-${device.at}`;
    button.addEventListener("click", () => choose(!drives));
    const setup = make("button", "", "Set up …");
    setup.type = "button";
    setup.dataset.testid = `pad-setup-${device.at}`;
    setup.addEventListener("click", () => this.open(device));
    return make("li", "", make("span", "", `${name}${drives ? ": drives" : ""}`), button, setup);
  }

  #choose(pad) {
    this.chosen.choose(pad, pad ? this.profileOf(pad.id) : null);
    this.listed = "";
    this.#list();
  }

  // -------------------------------------------------------------- the dialog

  open(device) {
    this.device = device;
    this.draft = structuredClone(this.profileOf(device.id));
    this.#fill();
    setText(byId("setup-device"), device.id);
    this.#say("Nothing here moves the robot.");
    this.on.opened(device);
    byId("pad-dialog").showModal();
    this.#loop();
  }

  #raw() {
    if (this.device.at === "console") return this.on.state()?.pad.connected ? this.on.state().pad.controls : null;
    const pad = navigator.getGamepads?.()[this.device.index];
    return pad?.connected && pad.id === this.device.id ? rawReading(pad) : null;
  }

  #loop() {
    if (!byId("pad-dialog").open) return;
    const raw = this.#raw();
    if (raw) this.picture.draw(corrected(raw, this.draft));
    setText(byId("setup-state"), raw ? "" : "It is not connected.");
    const armed = this.on.state()?.phase !== "disarmed";
    byId("setup-apply").disabled = armed;
    byId("setup-armed").hidden = !armed;
    requestAnimationFrame(() => this.#loop());
  }

  #calibrate() {
    const c = this.calibrating;
    const raw = c && this.#raw();
    if (!raw) return;
    const values = [...raw.left, ...raw.right];
    const now = performance.now() - c.began;
    if (now < REST_MS || !c.rest.length) {
      c.rest.push(values);
      this.#say("Let go of both sticks …");
    } else if (now < REST_MS + SWEEP_MS) {
      c.centre ??= c.rest[0].map((_, i) => c.rest.reduce((sum, v) => sum + v[i], 0) / c.rest.length);
      values.forEach((value, i) => {
        c.low[i] = Math.min(c.low[i], value - c.centre[i]);
        c.high[i] = Math.max(c.high[i], value - c.centre[i]);
      });
      this.#say(`Now turn both sticks along their edge … ${Math.ceil((REST_MS + SWEEP_MS - now) / 1000)} s`);
    } else {
      this.calibrating = null;
      const reach = c.low.map((low, i) => Math.min(1, -low, c.high[i]));
      if (!c.centre || c.centre.some((value) => Math.abs(value) > 0.5) || reach.some((value) => value < 0.3)) {
        this.#say("That did not work: every stick has to go from its centre to its edge on all sides. Try again.");
        return;
      }
      this.draft.centre = c.centre.map((value) => Math.round(1000 * value) / 1000);
      this.draft.reach = reach.map((value) => Math.round(1000 * value) / 1000);
      this.#say("Calibrated. Try it, then apply.");
    }
  }

  #form() {
    const { draft } = this;
    for (const [id, name] of [["dead-zone", "stick_dead_zone"], ["trigger-zone", "trigger_dead_zone"], ["expo", "expo"]]) {
      byId(id).addEventListener("input", (event) => {
        this.draft.shape[name] = Number(event.target.value);
        setText(byId(`${id}-value`), `${Math.round(100 * event.target.value)} %`);
      });
    }
    byId("inverts").replaceChildren(...Object.entries(AXES).map(([axis, label]) => {
      const box = make("input");
      box.type = "checkbox";
      box.dataset.axis = axis;
      box.addEventListener("change", () => {
        this.draft.invert = this.draft.invert.filter((name) => name !== axis).concat(box.checked ? [axis] : []);
      });
      return make("label", "", box, ` invert ${label}`);
    }));
    byId("swap").addEventListener("change", (event) => {
      this.draft.swap_sticks = event.target.checked;
    });
    for (const id of ["exchange-a", "exchange-b"]) {
      byId(id).replaceChildren(...BUTTONS.map((name) => make("option", "", name.replace("_", " "))));
      [...byId(id).options].forEach((option, i) => {
        option.value = BUTTONS[i];
      });
    }
    byId("exchange-b").value = "b";
    byId("exchange").addEventListener("click", () => {
      const [a, b] = [byId("exchange-a").value, byId("exchange-b").value];
      const of = (name) => this.draft.assign[name] ?? name;
      const [doesA, doesB] = [of(a), of(b)];
      this.draft.assign = { ...this.draft.assign, [a]: doesB, [b]: doesA };
      this.#showAssigned();
    });
    byId("calibrate").addEventListener("click", () => {
      this.draft.centre = [...AS_BUILT.centre];
      this.draft.reach = [...AS_BUILT.reach];
      this.calibrating = { began: performance.now(), rest: [], low: [0, 0, 0, 0], high: [0, 0, 0, 0] };
    });
    byId("setup-reset").addEventListener("click", () => {
      this.draft = structuredClone(AS_BUILT);
      this.#fill();
      this.#say("As built. Apply to keep it.");
    });
    byId("setup-apply").addEventListener("click", () => this.#apply());
    byId("setup-close").addEventListener("click", () => byId("pad-dialog").close());
    byId("pad-dialog").addEventListener("close", () => {
      this.calibrating = null;
      this.on.closed(this.device);
    });
    this.draft = draft;
  }

  #fill() {
    const { shape, invert, swap_sticks: swapped } = this.draft;
    for (const [id, value] of [["dead-zone", shape.stick_dead_zone], ["trigger-zone", shape.trigger_dead_zone], ["expo", shape.expo]]) {
      byId(id).value = value;
      setText(byId(`${id}-value`), `${Math.round(100 * value)} %`);
    }
    for (const box of byId("inverts").querySelectorAll("input")) box.checked = invert.includes(box.dataset.axis);
    byId("swap").checked = swapped;
    this.#showAssigned();
  }

  #showAssigned() {
    const rows = Object.entries(this.draft.assign).filter(([pressed, does]) => pressed !== does);
    byId("assigned").replaceChildren(...rows.map(([pressed, does]) => make("li", "", `${pressed.replace("_", " ")} does what ${does.replace("_", " ")} did`)));
  }

  async #apply() {
    const body = JSON.stringify({ device: this.device.id.slice(0, 160), profile: this.draft });
    const reply = await fetch(`${PLACE}pads`, { method: "POST", body }).then((r) => r.json()).catch(() => ({ ok: false, reasons: ["the console does not answer"] }));
    this.#say(reply.ok ? "Applied, and kept for this device." : `Not applied: ${reply.reasons.join("; ")}`);
    if (!reply.ok) return;
    await this.#load();
    if (this.device.id === this.chosen.id) this.chosen.profile = this.profileOf(this.device.id);
  }

  #say(text) {
    setText(byId("setup-message"), text);
  }
}

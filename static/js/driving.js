// What the driver holds and moves on this page, as one reading in the layout of a pad, and when it is sent.
//
// Hold-to-run: every on-screen drive control is its own dead-man, and so is the space bar for the keys.
// Every press begins centred: keys that are down before the space bar do not count until they are pressed anew.
// `end()` lets everything go; nothing resumes until it is pressed anew.

const TICK_MS = 20; // 50 Hz while something is held or has just changed …
const PAD_MS = 4; // The Gamepad API tells of no change: the pad is looked at this often, and a change is sent at once.
const IDLE_TICKS = 5; // … else 10 Hz, so that nobody takes an idle page for a silent one.
const RECENT_MS = 300;
const CENTRE = [0, 0];
const AT_REST = { left: CENTRE, right: CENTRE, lt: 0, rt: 0, buttons: [] };

export class Driving {
  /** @param send called with each reading; @param show called when the reading changed */
  constructor(send, show) {
    this.send = send;
    this.show = show;
    this.may = false;
    this.keys = new Set();
    this.pressed = new Map(); // on-screen control → its value
    this.pad = null; // a `ChosenPad`
    this.padReading = null;
    this.letGo = []; // called by end(), so that the widgets let their pointers go
    this.last = "";
    this.wasHeld = false;
    this.changedAt = -Infinity;
    this.ticks = 0;
    setInterval(() => this.#tick(), TICK_MS);
    setInterval(() => this.#lookAtPad(), PAD_MS);
  }

  /** Whether this page may drive now. What is held in the moment that it may again must be let go first. */
  get enabled() {
    return this.may;
  }

  set enabled(yes) {
    if (yes && !this.may) this.pad?.distrust();
    this.may = yes;
  }

  /** An on-screen control is pressed, or moved to another value. */
  press(control, value = true) {
    if (!this.enabled) return;
    this.pressed.set(control, value);
    this.#changed();
  }

  release(control) {
    if (this.pressed.delete(control)) this.#changed();
  }

  keyDown(code) {
    if (!this.enabled) return;
    if (code === "Space") this.keys.clear();
    this.keys.add(code);
    this.#changed();
  }

  keyUp(code) {
    if (this.keys.delete(code)) this.#changed();
  }

  /** Let everything go, now. */
  end() {
    this.keys.clear();
    this.pressed.clear();
    this.pad?.distrust();
    if (this.padReading) this.padReading = { ...this.padReading, held: false };
    for (const release of this.letGo) release();
    this.#changed();
  }

  /** The dead-man of the keyboard, of the page or of the chosen pad is held. */
  get held() {
    return this.byHand || Boolean(this.padReading?.held);
  }

  get byHand() {
    return this.pressed.size > 0 || this.keys.has("Space");
  }

  reading() {
    if (!this.byHand) return (this.enabled && this.padReading) || { ...AT_REST, held: false };
    const key = (code) => (this.keys.has(code) ? 1 : 0);
    const on = (control) => (this.pressed.has(control) ? 1 : 0);
    const either = (control, code) => Math.max(on(control), key(code));
    const twist = either("twist-right", "KeyE") - either("twist-left", "KeyQ");
    const right = this.pressed.get("stick-right") ?? inCircle(
      key("ArrowRight") - key("ArrowLeft"), key("ArrowDown") - key("ArrowUp"));
    return {
      left: this.pressed.get("stick-left") ?? inCircle(key("KeyD") - key("KeyA"), key("KeyS") - key("KeyW")),
      // As on the pad: with the right bumper, the right stick twists.
      right: twist ? [twist, 0] : right,
      lt: either("feed-out", "KeyF"),
      rt: either("feed-in", "KeyR"),
      buttons: [...(twist ? ["right_shoulder"] : []), ...(this.keys.has("KeyC") ? ["a"] : [])],
      held: true,
    };
  }

  #changed() {
    const reading = this.reading();
    const text = JSON.stringify(reading);
    if (text === this.last) return;
    this.last = text;
    this.changedAt = performance.now();
    this.ticks = 0;
    if (reading.held && !this.wasHeld && !reading.device) this.send({ ...AT_REST, held: true });
    this.wasHeld = reading.held;
    this.send(reading);
    this.show(reading);
  }

  #lookAtPad() {
    const pad = this.pad?.reading() ?? null;
    if (!pad && !this.padReading) return;
    this.padReading = pad;
    this.#changed();
  }

  #tick() {
    this.ticks += 1;
    const busy = this.held || performance.now() - this.changedAt < RECENT_MS;
    if (busy || this.ticks >= IDLE_TICKS) {
      this.ticks = 0;
      this.send(this.reading());
    }
  }
}

/** A stick's position cut to the unit circle, to thousandths. */
export function inCircle(x, y) {
  const length = Math.max(1, Math.hypot(x, y));
  return [Math.round((x / length) * 1000) / 1000, Math.round((y / length) * 1000) / 1000];
}

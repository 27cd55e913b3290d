// A pad plugged into this computer (Gamepad API). Nothing drives but the pad that somebody chose on this page.

const BUTTONS = {
  0: "a", 1: "b", 2: "x", 3: "y", 4: "left_shoulder", 5: "right_shoulder", 8: "back", 9: "start",
  10: "left_stick", 11: "right_stick", 12: "dpad_up", 13: "dpad_down", 14: "dpad_left", 15: "dpad_right",
};
const AXES = ["left_x", "left_y", "right_x", "right_y"];
export const AS_BUILT = {
  centre: [0, 0, 0, 0], reach: [1, 1, 1, 1], invert: [], swap_sticks: false, assign: {},
  shape: { stick_dead_zone: 0.12, trigger_dead_zone: 0.05, expo: 0.5 },
};

/** Pads with a known layout that the browser tells of; it tells of one only after a button of it was pressed. */
export function padsHere() {
  if (!navigator.getGamepads) return null; // not a secure context
  return [...navigator.getGamepads()].filter((pad) => pad && pad.connected && pad.axes.length > 0);
}

/** A pad's reading as it comes. */
export function rawReading(pad) {
  const axis = (i) => Math.min(1, Math.max(-1, pad.axes[i] ?? 0));
  const pull = (i) => Math.min(1, Math.max(0, pad.buttons[i]?.value ?? 0));
  return {
    left: [axis(0), axis(1)], right: [axis(2), axis(3)], lt: pull(6), rt: pull(7),
    buttons: Object.entries(BUTTONS).filter(([i]) => pad.buttons[i]?.pressed).map(([, name]) => name),
  };
}

/** Calibrated, inverted, swapped and assigned: the same as the console does with a pad of its own. */
export function corrected(raw, profile) {
  const values = [...raw.left, ...raw.right].map((value, i) => {
    const moved = Math.min(1, Math.max(-1, (value - profile.centre[i]) / profile.reach[i]));
    return profile.invert.includes(AXES[i]) ? -moved : moved;
  });
  const [left, right] = [values.slice(0, 2), values.slice(2)];
  return {
    ...raw,
    left: profile.swap_sticks ? right : left,
    right: profile.swap_sticks ? left : right,
    buttons: raw.buttons.map((name) => profile.assign[name] ?? name),
  };
}

/** The pad that drives from this page, once it was chosen. */
export class ChosenPad {
  /** @param on {lost(name), stop()} */
  constructor(on) {
    this.on = on;
    this.id = "";
    this.index = -1;
    this.profile = AS_BUILT;
    this.trusted = false; // its dead-man has been seen up since it was chosen, lost, or the drive was ended
    this.stopping = false;
    window.addEventListener("gamepaddisconnected", (event) => {
      if (event.gamepad.index === this.index) this.#lose();
    });
  }

  choose(pad, profile) {
    this.id = pad?.id ?? "";
    this.index = pad?.index ?? -1;
    this.profile = profile ?? AS_BUILT;
    this.trusted = false;
  }

  /** Whatever is held now must be let go before it drives again. */
  distrust() {
    this.trusted = false;
  }

  /** The reading to send; null while nothing is chosen or it is away. */
  reading() {
    if (!this.id) return null;
    const pad = navigator.getGamepads()[this.index];
    // Another pad under the same number is not the one that was chosen.
    if (!pad?.connected || pad.id !== this.id) {
      this.#lose();
      return null;
    }
    const now = corrected(rawReading(pad), this.profile);
    const stopping = now.buttons.includes("b");
    if (stopping && !this.stopping) this.on.stop();
    this.stopping = stopping;
    const down = now.buttons.includes("left_shoulder");
    if (!down && !stopping) this.trusted = true;
    return {
      ...now, buttons: now.buttons.filter((name) => name !== "left_shoulder"),
      held: down && this.trusted && !stopping, device: this.id.slice(0, 160),
    };
  }

  #lose() {
    const name = this.id;
    this.choose(null);
    this.on.lost(name);
  }
}

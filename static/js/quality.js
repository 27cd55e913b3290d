// The link to the console: latency, jitter and drops, and what is done about them.

import { figure } from "./format.js";

const WARN_MS = 100;
const SLOW_MS = 200; // from here on the console drives slower …
const HOLD_MS = 500; // … and from here on the robot holds
const KEPT = 20;

export class Quality {
  constructor() {
    this.trips = [];
    this.lost = 0;
  }

  /** A round trip as the echoed stamp tells it [ms]. */
  take(ms) {
    this.trips.push(ms);
    if (this.trips.length > KEPT) this.trips.shift();
  }

  reset() {
    this.trips = [];
  }

  get latency() {
    if (!this.trips.length) return NaN;
    return [...this.trips].sort((a, b) => a - b)[Math.floor(this.trips.length / 2)];
  }

  /** Mean change from one round trip to the next [ms]. */
  get jitter() {
    const steps = this.trips.slice(1).map((ms, i) => Math.abs(ms - this.trips[i]));
    return steps.length ? steps.reduce((sum, step) => sum + step, 0) / steps.length : NaN;
  }

  /** What to say about it, and how bad it is: "", "near" or "at". */
  verdict() {
    const ms = Math.round(this.latency);
    if (ms >= HOLD_MS) return ["at", `The link is too slow to drive: ${ms} ms, the robot holds. Come closer to the network.`];
    if (ms >= SLOW_MS) return ["at", `The link is slow: ${ms} ms. The robot moves slower. Make small moves and wait.`];
    if (ms >= WARN_MS) return ["near", `The link is getting slow: ${ms} ms. Move gently.`];
    return ["", ""];
  }

  text() {
    return `${figure(this.latency)} ms ± ${figure(this.jitter)}`;
  }
}

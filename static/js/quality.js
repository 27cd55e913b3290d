// The link to the console: latency, jitter and drops, and what is done about them.

import { figure } from "./format.js";

const WARN_MS = 100;
const SLOW_MS = 200; // from here on the console drives slower …
const HOLD_MS = 500; // … and from here on the robot holds
const KEPT = 20;
const OLD_MS = 500; // What is shown from then on is not where the robot is.
const DRIFT_MS = 0.05; // A trip: what was measured long ago loses its worth, for two clocks do not run alike.

export class Quality {
  constructor() {
    this.trips = [];
    this.lost = 0;
    this.best = Infinity;
    this.clock = NaN; // the console's clock less ours [ms]
  }

  /** A round trip as the echoed stamp tells it, and the console's clock when it answered less ours now [ms]. */
  take(ms, ahead = NaN) {
    this.trips.push(ms);
    if (this.trips.length > KEPT) this.trips.shift();
    this.best += DRIFT_MS;
    if (!Number.isFinite(ahead) || ms > this.best) return;
    // The quickest trip had the least of waiting in it: half of it is each way.
    this.best = ms;
    this.clock = ahead + ms / 2;
  }

  reset() {
    this.trips = [];
    this.best = Infinity;
    this.clock = NaN;
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

  /** What to say about it, and how bad it is: "", "near" or "at". `age` of what is shown [ms]; `drives`: one who may;
   * `further`: round trip between console and robot [ms]. */
  verdict(age, drives, further = 0) {
    const ms = Math.round(this.latency + further);
    if (!drives) return age >= OLD_MS ? ["at", `What you see is ${figure(age / 1e3, 1)} s old: the link is slow.`] : ["", ""];
    if (ms >= HOLD_MS) return ["at", `The link is too slow to drive: ${ms} ms, the robot holds. Come closer to the network.`];
    if (ms >= SLOW_MS) return ["at", `The link is slow: ${ms} ms. The robot moves slower. Make small moves and wait.`];
    if (ms >= WARN_MS) return ["near", `The link is getting slow: ${ms} ms. Move gently.`];
    return ["", ""];
  }

  text() {
    return `${figure(this.latency)} ms ± ${figure(this.jitter)}`;
  }
}

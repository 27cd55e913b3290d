// The websocket to the console: snapshots in, controls and requests out. Reconnects by itself; never drives by itself.

import { PLACE } from "./format.js";
import { Quality } from "./quality.js";

const STALE_MS = 600; // No snapshot for this long: what is on the screen is not the robot's state any more.
const PING_MS = 250;
const STALLED_BYTES = 2048; // More than this unsent: the line is stuck, and old controls must not pile up behind it.
const SESSION_OVER = 4401;
const LOST = { ok: false, reasons: ["the connection to the console is lost"] };

export class Link {
  /** @param on {welcome(facts), snapshot(state), connected(yes)} */
  constructor(on) {
    this.on = on;
    this.connected = false;
    this.quality = new Quality();
    this.pings = 0; // sent and not answered
    this.page = "";
    this.echo = 0;
    this.sequence = 0;
    this.requests = new Map();
    this.requestId = 0;
    this.retryMs = 250;
    this.heard = -Infinity;
    this.state = {};
    this.thin = false;
    this.view = `p-${Math.random().toString(36).slice(2, 12)}`; // by this the console knows our 3D views
    this.behind = false; // whether they are more than the link carries
    setInterval(() => this.#watch(), 100);
    setInterval(() => this.#ping(), PING_MS);
    this.#open();
  }

  /** Send one reading of the controls. Returns whether it left. */
  controls(reading) {
    if (reading.held && this.socket.bufferedAmount > STALLED_BYTES) return false;
    this.sequence += 1;
    return this.#send({
      type: "controls", seq: this.sequence, stamp: performance.now(), echo: this.echo,
      since: Math.max(0, performance.now() - this.heard), ...reading,
    });
  }

  /** Ask for something; resolves to {ok, reasons}, also when the line breaks. */
  act(what, value = null, text = "") {
    return new Promise((resolve) => {
      const id = ++this.requestId;
      if (this.#send({ type: "act", id, what, value, text })) this.requests.set(id, resolve);
      else resolve(LOST);
    });
  }

  /** Whether to be sent little: what changed, less often. Kept over a reconnection. */
  pace(thin) {
    this.thin = thin;
    this.#send({ type: "pace", thin, view: this.view });
  }

  /** How old what is shown is [ms]: since the robot said it, over its own link and ours. NaN while that is not known. */
  age() {
    return performance.now() + this.quality.clock - this.echo * 1e3 + (this.state.link?.age_ms ?? 0);
  }

  #ping() {
    // An answer that is still out after a whole period tells as much as one that came.
    if (this.pings > 0 && this.connected) this.quality.take(performance.now() - this.pingedAt);
    if (this.pings > 1) this.quality.lost += 1;
    if (this.#send({ type: "ping", stamp: performance.now() })) {
      if (this.pings === 0) this.pingedAt = performance.now();
      this.pings += 1;
    }
  }

  #open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}${PLACE}ws`);
    this.socket = socket;
    this.sequence = 0;
    this.pings = 0;
    socket.onmessage = (event) => {
      if (socket === this.socket) this.#take(JSON.parse(event.data));
    };
    socket.onclose = (event) => {
      // Signing in again, or with another role, begins a new page.
      if (event.code === SESSION_OVER) location.reload();
      else if (socket === this.socket) this.#reopen();
    };
  }

  #reopen() {
    this.socket = { readyState: WebSocket.CLOSED, bufferedAmount: 0 };
    this.#setConnected(false);
    for (const resolve of this.requests.values()) resolve(LOST);
    this.requests.clear();
    setTimeout(() => this.#open(), this.retryMs);
    this.retryMs = Math.min(2000, this.retryMs * 1.5);
  }

  #take(message) {
    switch (message.type) {
      case "welcome":
        this.page = message.page;
        this.retryMs = 250;
        this.pace(this.thin);
        this.on.welcome(message);
        break;
      case "snapshot":
        this.echo = message.stamp;
        this.heard = performance.now();
        // Over a slow link only what changed is sent.
        this.state = { ...this.state, ...message };
        this.#setConnected(true);
        this.on.snapshot(this.state);
        break;
      case "reply":
        this.requests.get(message.id)?.(message);
        this.requests.delete(message.id);
        break;
      case "pong":
        this.quality.take(performance.now() - message.stamp, 1e3 * message.now - performance.now());
        this.behind = message.behind;
        this.pings -= 1;
        break;
    }
  }

  #watch() {
    if (this.connected && performance.now() - this.heard > STALE_MS) this.#setConnected(false);
  }

  #setConnected(yes) {
    if (yes === this.connected) return;
    this.connected = yes;
    if (!yes) this.quality.reset();
    this.on.connected(yes);
  }

  #send(message) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}

// The websocket to the console: snapshots in, controls and requests out. Reconnects by itself; never drives by itself.

import { PLACE } from "./format.js";

const STALE_MS = 600; // No snapshot for this long: what is on the screen is not the robot's state any more.
const PING_MS = 1000;
const STALLED_BYTES = 2048; // More than this unsent: the line is stuck, and old controls must not pile up behind it.
const SESSION_OVER = 4401;
const LOST = { ok: false, reasons: ["the connection to the console is lost"] };

export class Link {
  /** @param on {welcome(facts), snapshot(state), connected(yes)} */
  constructor(on) {
    this.on = on;
    this.connected = false;
    this.roundTrip = NaN;
    this.page = "";
    this.echo = 0;
    this.sequence = 0;
    this.requests = new Map();
    this.requestId = 0;
    this.retryMs = 250;
    this.heard = -Infinity;
    setInterval(() => this.#watch(), 100);
    setInterval(() => this.#send({ type: "ping", stamp: performance.now() }), PING_MS);
    this.#open();
  }

  /** Send one reading of the controls. Returns whether it left. */
  controls(reading) {
    if (reading.held && this.socket.bufferedAmount > STALLED_BYTES) return false;
    this.sequence += 1;
    return this.#send({
      type: "controls", seq: this.sequence, stamp: performance.now(), echo: this.echo, ...reading,
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

  #open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}${PLACE}ws`);
    this.socket = socket;
    this.sequence = 0;
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
        this.on.welcome(message);
        break;
      case "snapshot":
        this.echo = message.stamp;
        this.heard = performance.now();
        this.#setConnected(true);
        this.on.snapshot(message);
        break;
      case "reply":
        this.requests.get(message.id)?.(message);
        this.requests.delete(message.id);
        break;
      case "pong":
        this.roundTrip = performance.now() - message.stamp;
        break;
    }
  }

  #watch() {
    if (this.connected && performance.now() - this.heard > STALE_MS) this.#setConnected(false);
  }

  #setConnected(yes) {
    if (yes === this.connected) return;
    this.connected = yes;
    if (!yes) this.roundTrip = NaN;
    this.on.connected(yes);
  }

  #send(message) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}

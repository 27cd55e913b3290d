// The time line: what the robot did as a band of colours, tension and bend over it, events as ticks, and where we are.

import { byId, make } from "./format.js";

const BAND = 10; // height of a band of phases [px]
const COLORS = { ready: "--good", driving: "--go", homing: "--busy", commissioning: "--busy", holding: "--warn", stopped: "--bad", fault: "--bad" };

export class TimeLine {
  /** @param seek called with the time [s] that was pointed at */
  constructor(seek) {
    this.line = byId("line");
    this.recording = null;
    this.other = null;
    this.offset = 0;
    const at = (event) => {
      const box = this.line.getBoundingClientRect();
      const share = Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
      if (this.recording) seek(share * this.recording.duration);
    };
    this.line.addEventListener("pointerdown", (event) => {
      this.line.setPointerCapture(event.pointerId);
      at(event);
    });
    this.line.addEventListener("pointermove", (event) => {
      if (event.buttons) at(event);
    });
    new ResizeObserver(() => this.#paint()).observe(this.line);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#paint());
  }

  /** @param other what lies over the recording, if anything: its phases are a band of their own */
  show(recording, other) {
    this.recording = recording;
    this.other = other;
    this.line.setAttribute("aria-valuemax", recording.duration.toFixed(1));
    byId("ticks").replaceChildren(...recording.events.map((event) => {
      const tick = make("span", `tick ${event.level}`);
      tick.style.left = `${100 * event.time_s / Math.max(recording.duration, 0.001)}%`;
      return tick;
    }));
    this.#paint();
  }

  cursor(t) {
    if (!this.recording) return;
    byId("cursor").style.left = `${100 * t / Math.max(this.recording.duration, 0.001)}%`;
    this.line.setAttribute("aria-valuenow", t.toFixed(1));
  }

  /** @param offset the other recording's time less the first one's [s] */
  shift(offset) {
    if (offset === this.offset) return;
    this.offset = offset;
    this.#paint();
  }

  #paint() {
    const canvas = byId("curves");
    const { width, height } = this.line.getBoundingClientRect();
    const scale = devicePixelRatio || 1;
    canvas.width = width * scale;
    canvas.height = height * scale;
    if (!this.recording) return;
    const context = canvas.getContext("2d");
    context.scale(scale, scale);
    const x = (t) => (t / Math.max(this.recording.duration, 0.001)) * width;
    const band = (spans, offset, top) => {
      for (const span of spans) {
        context.fillStyle = this.#color(COLORS[span.what] ?? "--quiet");
        context.fillRect(x(span.start_s - offset), top, Math.max(1, x(span.end_s - span.start_s)), BAND);
      }
    };
    band(this.recording.phases, 0, height - BAND);
    if (this.other) {
      context.globalAlpha = 0.55;
      band(this.other.phases, this.offset, 0);
      context.globalAlpha = 1;
    }
    const low = this.other ? BAND + 4 : 8; // the curves' highest place
    const { step_s: step, tension_N: tension, bend_deg: bend } = this.recording.overview;
    const curve = (values, color) => {
      const top = Math.max(...values.map((value) => value ?? 0), 1e-9);
      context.strokeStyle = color;
      context.lineWidth = 1.5;
      context.beginPath();
      let pen = false;
      values.forEach((value, i) => {
        const y = height - BAND - 4 - ((value ?? 0) / top) * (height - BAND - 4 - low);
        if (value === null) pen = false;
        else if (pen) context.lineTo(x((i + 0.5) * step), y);
        else context.moveTo(x((i + 0.5) * step), y);
        pen = value !== null;
      });
      context.stroke();
    };
    curve(bend, this.#color("--bend"));
    curve(tension, this.#color("--tension"));
  }

  /** A colour of the style sheet as a canvas takes it: it does not know of light and dark. */
  #color(name) {
    this.line.style.color = `var(${name})`;
    const color = getComputedStyle(this.line).color;
    this.line.style.color = "";
    return color;
  }
}

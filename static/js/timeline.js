// The time line: what the robot did as a band of colours, tension and bend over it, events as ticks, and where we are.

import { byId, make } from "./format.js";

const BAND = 10; // height of the band of phases [px]
const COLORS = { ready: "--good", driving: "--go", homing: "--busy", holding: "--warn", stopped: "--bad", fault: "--bad" };

export class TimeLine {
  /** @param seek called with the time [s] that was pointed at */
  constructor(seek) {
    this.line = byId("line");
    this.recording = null;
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
  }

  show(recording) {
    this.recording = recording;
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

  #paint() {
    const canvas = byId("curves");
    const { width, height } = this.line.getBoundingClientRect();
    const scale = devicePixelRatio || 1;
    canvas.width = width * scale;
    canvas.height = height * scale;
    if (!this.recording) return;
    const context = canvas.getContext("2d");
    context.scale(scale, scale);
    const style = getComputedStyle(document.body);
    const x = (t) => (t / Math.max(this.recording.duration, 0.001)) * width;
    for (const span of this.recording.phases) {
      context.fillStyle = style.getPropertyValue(COLORS[span.what] ?? "--quiet");
      context.fillRect(x(span.start_s), height - BAND, Math.max(1, x(span.end_s) - x(span.start_s)), BAND);
    }
    const { step_s: step, tension_N: tension, bend_deg: bend } = this.recording.overview;
    const curve = (values, color) => {
      const top = Math.max(...values.map((value) => value ?? 0), 1e-9);
      context.strokeStyle = color;
      context.lineWidth = 1.5;
      context.beginPath();
      let pen = false;
      values.forEach((value, i) => {
        const y = height - BAND - 4 - ((value ?? 0) / top) * (height - BAND - 12);
        if (value === null) pen = false;
        else if (pen) context.lineTo(x((i + 0.5) * step), y);
        else context.moveTo(x((i + 0.5) * step), y);
        pen = value !== null;
      });
      context.stroke();
    };
    curve(bend, style.getPropertyValue("--accent"));
    curve(tension, "#f39a4a");
  }
}

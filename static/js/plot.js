// A live plot of any number that the page is told: the last half minute of the chosen channel.

import { byId, figure, make, setText } from "./format.js";

const SPAN_S = 30;
const DRAW_MS = 100;

export class Plot {
  constructor() {
    this.channels = [];
    this.history = []; // [seconds, values of all channels]
    this.drawnAt = 0;
    byId("channel").addEventListener("change", () => this.#draw());
  }

  /** Every snapshot is a sample. */
  take(state) {
    const channels = channelsOf(state);
    if (channels.length !== this.channels.length) this.#offer(channels);
    const now = performance.now() / 1000;
    this.history.push([now, channels.map(([, value]) => value)]);
    while (this.history.length && this.history[0][0] < now - SPAN_S) this.history.shift();
  }

  show() {
    const hidden = byId("panel-plot").hidden;
    if (!hidden && performance.now() - this.drawnAt > DRAW_MS) this.#draw();
  }

  #offer(channels) {
    this.channels = channels;
    this.history = [];
    const chosen = byId("channel").value;
    byId("channel").replaceChildren(...channels.map(([name, , unit], i) => {
      const option = make("option", "", `${name} [${unit}]`);
      option.value = i;
      return option;
    }));
    if (chosen) byId("channel").value = chosen;
  }

  #draw() {
    this.drawnAt = performance.now();
    const chosen = Number(byId("channel").value);
    const now = performance.now() / 1000;
    const points = this.history.map(([at, values]) => [at - now, values[chosen]]).filter(([, y]) => Number.isFinite(y));
    const unit = this.channels[chosen]?.[2] ?? "";
    const ys = points.map(([, y]) => y);
    let [low, high] = ys.length ? [Math.min(...ys), Math.max(...ys)] : [0, 1];
    if (high - low < 1e-3) [low, high] = [low - 0.5, high + 0.5];
    const path = points.map(([t, y], i) =>
      `${i ? "L" : "M"}${(300 * (1 + t / SPAN_S)).toFixed(1)} ${(100 - (100 * (y - low)) / (high - low)).toFixed(1)}`);
    byId("plot-line").setAttribute("d", path.join(""));
    setText(byId("plot-high"), `${figure(high, 2)} ${unit}`);
    setText(byId("plot-low"), `${figure(low, 2)} ${unit}`);
    setText(byId("plot-now"), `now ${figure(ys.at(-1), 2)} ${unit}`);
  }
}

/** Every number in a snapshot that has a name and a unit: [name, value, unit]. */
function channelsOf(state) {
  return [
    ...state.bends.map((bend) => [`Bend ${bend.name}`, bend.deg, "°"]),
    ["Twist", state.twist_deg, "°"], ["Feed", state.feed_mm, "mm"],
    ...["x", "y", "z"].map((axis, i) => [`Tip ${axis}`, state.tip_mm[i], "mm"]),
    ...state.drives.flatMap((drive) => [
      [`${drive.name} load`, drive.load, drive.moves === "twist" ? "N·m" : "N"],
      [`${drive.name} temperature`, drive.temperature, "°C"], [`${drive.name} supply`, drive.voltage, "V"],
      [`${drive.name} age`, drive.age_ms, "ms"],
    ]),
    ["Loop rate", state.timing.rate_Hz, "Hz"], ["Loop period, 99 %", 1e3 * state.timing.period_p99, "ms"],
    ["States at the console", state.console_rate, "Hz"], ["Age of the state", state.link.age_ms, "ms"],
  ];
}

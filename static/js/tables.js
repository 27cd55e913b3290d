// Drives, health and events, behind the tabs.

import { ago, byId, figure, make, setList, setProperty, setText } from "./format.js";

const HOT = 0.5; // refresh period [s] of what people read rather than watch

/** The tabs: click, or arrow keys as in every tab list. */
export function tabs() {
  const all = [...document.querySelectorAll("[role=tab]")];
  const choose = (chosen) => {
    for (const tab of all) {
      const yes = tab === chosen;
      tab.setAttribute("aria-selected", yes);
      tab.tabIndex = yes ? 0 : -1;
      byId(tab.getAttribute("aria-controls")).hidden = !yes;
    }
  };
  all.forEach((tab, i) => {
    tab.addEventListener("click", () => choose(tab));
    tab.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[event.code];
      if (!step || event.defaultPrevented) return;
      const next = all[(i + step + all.length) % all.length];
      choose(next);
      next.focus();
    });
  });
}

export class Tables {
  constructor() {
    this.rows = [];
    this.cellRows = [];
    this.shownAt = -Infinity;
  }

  snapshot(state) {
    const now = performance.now() / 1000;
    if (now - this.shownAt < HOT) return;
    this.shownAt = now;
    this.#showDrives(state.drives);
    this.#showCells(state.commissioning?.cells ?? []);
    showHealth(state);
    setList(byId("events"), state.events.map((event) => [event.level, `${ago(event.ago)} ago · ${event.text}`]));
    const alarms = state.events.filter((event) => event.level === "alarm" && event.ago < 60).length;
    setText(byId("tab-events"), alarms ? `Events (${alarms})` : "Events");
    const faults = state.drives.filter((drive) => drive.fault || silence(drive)).length;
    setText(byId("tab-drives"), faults ? `Drives (${faults})` : "Drives");
  }

  #showDrives(drives) {
    if (this.rows.length !== drives.length) this.rows = fresh("drives", drives.length, 7);
    drives.forEach((drive, i) => {
      const unit = drive.moves === "twist" ? "N·m" : "N";
      const cells = [
        drive.name, `${figure(drive.load, 1, 5)} ${unit}`, `${figure(drive.current, 2, 5)} A`,
        `${figure(drive.temperature, 0, 2)} °C`, `${figure(drive.voltage, 1, 4)} V`, `${figure(drive.age_ms, 0, 3)} ms`,
        drive.fault || silence(drive) || drive.warning || "fine",
      ];
      fill(this.rows[i], cells);
      this.rows[i].classList.toggle("bad", Boolean(drive.fault || silence(drive)));
      this.rows[i].classList.toggle("near", Boolean(drive.warning));
    });
  }

  /** Two witnesses of one tension, side by side; where they disagree, one of them is wrong. */
  #showCells(cells) {
    setProperty(byId("cell-table"), "hidden", !cells.length);
    if (this.cellRows.length !== cells.length) this.cellRows = fresh("cells", cells.length, 5);
    cells.forEach((cell, i) => {
      const apart = cell.tension === null || cell.from_current === null ? NaN : cell.tension - cell.from_current;
      fill(this.cellRows[i], [
        cell.tendon, ...[cell.tension ?? NaN, cell.from_current ?? NaN, apart].map((newtons) => `${figure(newtons, 1, 5)} N`),
        cell.trouble || "fine",
      ]);
      this.cellRows[i].classList.toggle("bad", Boolean(cell.trouble));
    });
  }
}

function fresh(body, count, columns) {
  const rows = Array.from({ length: count }, () => make("tr", "", ...Array.from({ length: columns }, () => make("td"))));
  byId(body).replaceChildren(...rows);
  return rows;
}

function fill(row, texts) {
  texts.forEach((text, j) => setText(row.children[j], text));
}

// One lost reply is nothing; five in a row hold the robot.
function silence(drive) {
  return drive.missed >= 5 ? "no answer: check its power and cable" : "";
}

function showHealth(state) {
  const timing = state.timing;
  const ms = (seconds) => `${figure(1000 * seconds, 2)} ms`;
  const facts = [
    ["Control loop", `${figure(timing.rate_Hz)} Hz${timing.realtime ? ", real-time scheduling" : ""}`],
    ["Period, 99 % below", `${ms(timing.period_p99)}, at most ${ms(timing.period_max)}`],
    ["Computing, 99 % below", ms(timing.compute_p99)],
    ["Late ticks", figure(timing.late)],
    ["States at the console", `${figure(state.console_rate)} a second`],
    ...(state.channels ?? []).map(({ name, load, trouble }) => [
      `Bus ${name}`, trouble || `${figure(100 * load)} % of its bit rate`,
    ]),
  ];
  const list = byId("timing");
  if (list.children.length !== facts.length) {
    list.replaceChildren(...facts.map(([name]) => make("div", "", make("dt", "", name), make("dd"))));
  }
  facts.forEach(([, text], i) => setText(list.children[i].lastElementChild, text));
  setList(byId("notes"), state.notes ?? []);
  const counters = [["Commands", state.drops], ["Bus", state.bus], ["Page", state.page_drops]].flatMap(
    ([where, counts]) => Object.entries(counts ?? {}).filter(([, n]) => n > 0).map(([what, n]) => `${where}: ${what}, ${n}`),
  );
  setList(byId("counters"), counters.length ? counters : ["Nothing."]);
  setText(byId("tab-health"), counters.length ? `Health (${counters.length})` : "Health");
}

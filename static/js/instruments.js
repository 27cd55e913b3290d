// Bends as dials, twist and feed as bars, tensions as columns: each with its limits.

import { byId, figure, make, setAttribute, setProperty, setStyle, setText } from "./format.js";
import { Profile } from "./profile.js";
import { rampColour } from "./ramp.js";

const NEAR = 0.85; // of a limit
const AT = 0.97;
const DIAL = 44;

export class Instruments {
  constructor() {
    this.dials = [];
    this.columns = [];
    this.facts = null;
    this.profile = new Profile(byId("tensions"), byId("profile"));
  }

  welcome(facts) {
    this.facts = facts;
    const groups = [];
    this.columns = facts.tendons.map((name) => {
      const fill = make("i");
      const end = make("b");
      const value = make("output");
      const column = make("div", "column", value, make("div", "shaft", fill, end), make("span", "", name));
      column.tabIndex = 0;
      column.setAttribute("role", "group");
      column.setAttribute("aria-label", `Tendon ${name}`);
      column.setAttribute("aria-describedby", "profile");
      groups.push(column);
      return { column, fill, end, value };
    });
    byId("tensions").replaceChildren(...groups);
    this.profile.welcome(facts, groups);
    byId("tensions").closest("section").hidden = facts.tendons.length === 0;
    byId("bends").hidden = facts.bending.length === 0;
    showRow("twist", facts.limits.twist_deg);
    // Fed by hand there is a length and no range of a drive's.
    showRow("feed", facts.limits.feed_mm || facts.hand_fed);
    byId("feed").classList.toggle("by-hand", facts.hand_fed);
    this.dials = [];
  }

  snapshot(state) {
    if (!this.facts) return;
    if (this.dials.length !== state.bends.length) this.#buildDials(state.bends);
    state.bends.forEach((bend, i) => this.#showBend(this.dials[i], bend, i === state.section));
    const { twist_deg: twist, feed_mm: feed } = this.facts.limits;
    if (twist) showBar("twist", state.twist_deg, twist, `${figure(state.twist_deg, 1, 6)} °`);
    if (feed) showBar("feed", state.feed_mm, feed, `${figure(state.feed_mm, 1, 6)} mm`);
    else setText(byId("feed-value"), `${figure(state.feed_mm, 1, 6)} mm`);
    ["x", "y", "z"].forEach((axis, i) => {
      setText(byId(`tip-${axis}`), `${axis} ${figure(state.tip_mm[i], 1, 6)} mm`);
    });
    const limit = state.tension_limits?.max ?? this.facts.max_tension_N;
    const friction = state.tendons?.compensation === "none" ? " with the gears' friction" : "";
    setText(byId("tension-limit"), `N${friction}, limit ${figure(limit)} N`);
    const profiles = state.profiles ?? [];
    this.columns.forEach((column, i) => showTension(column, state.tensions[i], profiles[i]?.at(-1), limit));
    this.profile.snapshot(profiles, limit);
  }

  #buildDials(bends) {
    this.dials = bends.map((bend, i) => {
      const box = make("div", "dial");
      box.innerHTML = `
        <svg viewBox="-50 -50 100 100" role="img">
          <circle class="limit" r="${DIAL}"/><circle class="half" r="${DIAL / 2}"/>
          <path class="cross" d="M-${DIAL} 0H${DIAL}M0-${DIAL}V${DIAL}"/>
          <line class="vector"/><circle class="dot" r="6"/>
        </svg>`;
      const value = make("output");
      box.append(make("span", "", bend.name), value);
      const passive = !this.facts.bending.includes(i);
      box.classList.toggle("passive", passive);
      return {
        box, passive, value, svg: box.querySelector("svg"), line: box.querySelector("line"), dot: box.querySelector(".dot"),
      };
    });
    byId("bends").replaceChildren(...this.dials.map((dial) => dial.box));
  }

  #showBend(dial, bend, chosen) {
    if (dial.passive) {
      // No tendon tells how it bends.
      setText(dial.value, "passive");
      return;
    }
    const known = Number.isFinite(bend.deg) && Number.isFinite(bend.dir_deg) && bend.limit_deg > 0;
    const share = known ? Math.min(1.1, bend.deg / bend.limit_deg) : 0;
    const angle = known ? (bend.dir_deg * Math.PI) / 180 : 0;
    const [x, y] = [share * DIAL * Math.cos(angle), share * DIAL * Math.sin(angle)].map((v) => v.toFixed(1));
    setAttribute(dial.dot, "cx", x);
    setAttribute(dial.dot, "cy", y);
    setAttribute(dial.line, "x2", x);
    setAttribute(dial.line, "y2", y);
    setAttribute(dial.box, "data-level", level(share));
    dial.box.classList.toggle("chosen", chosen);
    const text = `${figure(bend.deg, 1, 4)}° of ${figure(bend.limit_deg)}°`;
    if (dial.value.textContent !== text) {
      dial.value.textContent = text;
      dial.svg.setAttribute("aria-label", `${bend.name} section bends ${text}`);
    }
  }
}

/** A bar with its name and value: shown where the robot has what it tells. */
function showRow(id, there) {
  for (const part of [byId(id).previousElementSibling, byId(id), byId(`${id}-value`)]) part.hidden = !there;
}

export function showBar(id, value, range, text) {
  const bar = byId(id);
  setText(byId(`${id}-value`), text);
  const [low, high] = range;
  const known = Number.isFinite(value);
  const zero = Math.min(1, Math.max(0, -low / (high - low)));
  const centred = bar.classList.contains("centred");
  const share = known ? Math.min(1, Math.max(0, (value - low) / (high - low))) : centred ? zero : 0;
  const fill = bar.firstElementChild;
  if (centred) {
    setStyle(fill, "left", percent(Math.min(zero, share)));
    setStyle(fill, "width", percent(Math.abs(share - zero)));
  } else {
    setStyle(fill, "width", percent(share));
  }
  setAttribute(bar, "data-level", known && (share >= 0.995 || share <= 0.005) ? "at" : "");
  setAttribute(bar, "aria-label", `${id} ${text}, range ${figure(low)} to ${figure(high)}`);
}

/** A column as high as the tension at the motor, with a line across it where the tension is at the tendon's end. */
function showTension({ column, fill, end, value }, tension, atEnd, limit) {
  const known = Number.isFinite(tension);
  const share = known ? Math.min(1, Math.max(0, tension / limit)) : 0;
  // The columns are 44 pixels high: what is less than half of one is not drawn anew.
  const shown = Math.round(100 * share) / 100;
  setStyle(fill, "height", percent(shown));
  setStyle(fill, "background", known ? rampColour(shown) : "");
  setAttribute(column, "data-level", level(share));
  setText(value, figure(tension, tension < 99.95 ? 1 : 0, 4));
  setProperty(end, "hidden", !Number.isFinite(atEnd));
  setStyle(end, "bottom", percent(Math.round(100 * Math.min(1, (atEnd || 0) / limit)) / 100));
}

/** To a tenth: about a quarter of a pixel. */
function percent(share) {
  return `${(100 * share).toFixed(1)}%`;
}

function level(share) {
  return share >= AT ? "at" : share >= NEAR ? "near" : "";
}

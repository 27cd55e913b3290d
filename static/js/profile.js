// The tension along one tendon, beside its column while the mouse or the focus is on it: friction takes it away on the way.

import { figure, make, setProperty, setStyle, setText } from "./format.js";
import { rampColour } from "./ramp.js";

export class Profile {
  /** @param columns around all columns, @param card where it is shown */
  constructor(columns, card) {
    this.card = card;
    this.chosen = -1;
    this.built = "";
    const leave = () => this.#choose(-1);
    columns.addEventListener("pointerleave", leave);
    columns.addEventListener("focusout", leave);
    for (const event of ["pointerover", "focusin"]) {
      columns.addEventListener(event, ({ target }) => this.#choose(this.groups?.indexOf(target.closest(".column")) ?? -1));
    }
  }

  welcome(facts, groups) {
    this.facts = facts;
    this.groups = groups;
    this.#choose(-1);
  }

  snapshot(profiles, limit) {
    this.profiles = profiles;
    this.limit = limit;
    this.#show();
  }

  #choose(index) {
    this.chosen = index;
    this.#show();
  }

  #show() {
    const tensions = this.profiles?.[this.chosen] ?? [];
    setProperty(this.card, "hidden", tensions.length === 0);
    if (!tensions.length) return;
    const key = `${this.chosen} ${tensions.length}`;
    if (this.built !== key) this.#build(tensions.length);
    this.built = key;
    tensions.forEach((tension, i) => {
      const share = Math.min(1, Math.max(0, tension / this.limit));
      setStyle(this.rows[i].bar, "width", `${(100 * share).toFixed(1)}%`);
      setStyle(this.rows[i].bar, "background", rampColour(share));
      setText(this.rows[i].value, `${figure(tension, 1, 4)} N`);
    });
  }

  #build(count) {
    const places = ["motor", "port", ...this.facts.sections.map((name) => `end of ${name}`)].slice(0, count);
    const rows = places.map((place) => {
      const bar = make("i");
      const value = make("output");
      return { bar, value, row: make("p", "", make("span", "", place), make("span", "track", bar), value) };
    });
    this.rows = rows;
    const head = make("p", "head", `Tendon ${this.facts.tendons[this.chosen]}, along its way`);
    this.card.replaceChildren(head, ...rows.map(({ row }) => row));
  }
}

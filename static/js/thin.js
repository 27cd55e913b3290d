// The thin view: less detail, ten pictures and five readings a second, for a link that does not carry the full one.

import { byId } from "./format.js";

const OLD_MS = 400; // What is shown is later than this …
const FOR_MS = 3000; // … for this long: then the link does not carry what it is given.
const LOOK_MS = 250;
const KEY = "thin";

export class Thin {
  /**
   * @param link what is shown comes over it
   * @param on {change(thin), slow()}: `slow` when the link chose
   */
  constructor(link, on) {
    this.link = link;
    this.on = on;
    this.chosen = stored(); // by somebody, "yes" or "no"
    this.yes = this.chosen === "yes";
    this.oldSince = null;
    this.lookedAt = 0;
    byId("thin-toggle").addEventListener("click", () => {
      this.chosen = this.yes ? "no" : "yes";
      store(this.chosen);
      this.#choose(!this.yes);
    });
    this.#show();
    setInterval(() => this.#look(), LOOK_MS);
  }

  #choose(yes) {
    this.yes = yes;
    this.#show();
    this.on.change(yes);
  }

  #show() {
    byId("thin-toggle").setAttribute("aria-pressed", this.yes);
    this.link.pace(this.yes);
  }

  /** Whoever pressed the button knows better than this. */
  #look() {
    const busy = performance.now() - this.lookedAt > 2 * LOOK_MS; // then it is this computer that is late, not the link
    this.lookedAt = performance.now();
    if (this.yes || this.chosen) return;
    const old = !busy && !document.hidden && this.link.age() > OLD_MS;
    this.oldSince = old ? this.oldSince ?? performance.now() : null;
    if (this.link.behind || (old && performance.now() - this.oldSince > FOR_MS)) {
      this.#choose(true);
      this.on.slow();
    }
  }
}

function stored() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null;
  }
}

function store(value) {
  try {
    localStorage.setItem(KEY, value);
  } catch {
    // without storage the choice lasts as long as the page
  }
}

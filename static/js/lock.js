// A robot whose sections change their length: how long it is, whether it is rigid or bends, and the way from one to the other.

import { byId, figure, setAttribute, setProperty, setText } from "./format.js";
import { showBar } from "./instruments.js";

const WORDS = { continuum: "Continuum", locking: "Locking", rigid: "Rigid", unlocking: "Unlocking" };
const LOCKABLE = ["continuum", "unlocking"];

export class Lock {
  /** @param ask called with "lock" or "unlock" */
  constructor(ask) {
    this.facts = null;
    this.status = "none";
    byId("lock-button").addEventListener("click", () => ask(LOCKABLE.includes(this.status) ? "lock" : "unlock"));
  }

  welcome(facts) {
    this.facts = facts;
    const range = facts.limits.length_mm;
    for (const element of document.querySelectorAll(".of-length")) element.hidden = !range;
  }

  snapshot(state, phase) {
    const range = this.facts?.limits.length_mm;
    if (range) showBar("length", state.length_mm, range, `${figure(state.length_mm, 1, 6)} mm`);
    this.status = state.lock?.status ?? "none";
    setProperty(byId("lock"), "hidden", this.status === "none");
    if (this.status === "none") return;
    setAttribute(byId("lock"), "data-status", this.status);
    setText(byId("lock-word"), WORDS[this.status]);
    setText(byId("lock-words"), state.lock.words);
    setText(byId("lock-button"), LOCKABLE.includes(this.status) ? "Lock" : "Unlock");
    setProperty(byId("lock-button"), "disabled", !["ready", "holding"].includes(phase));
  }
}

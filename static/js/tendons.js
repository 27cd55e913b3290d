// What is known of the tendons beyond their tension: whether losses are taken out of the motion, and what is wrong, in words.

import { byId, make, setProperty, setText } from "./format.js";

export class Tendons {
  /** @param ask called with "compensation" and 1 for on, 0 for off */
  constructor(ask) {
    this.state = "none";
    this.shown = "";
    byId("compensation-button").addEventListener("click", () => ask("compensation", this.state === "on" ? 0 : 1));
  }

  snapshot(tendons, phase) {
    this.state = tendons?.compensation ?? "none";
    setProperty(byId("compensation"), "hidden", this.state === "none");
    setText(byId("compensation-words"), tendons?.words ?? "");
    setText(byId("compensation-button"), this.state === "on" ? "Switch off" : "Switch on");
    setProperty(byId("compensation-button"), "disabled", !["ready", "holding", "disarmed"].includes(phase));
    const warnings = tendons?.warnings ?? [];
    if (warnings.join() === this.shown) return;
    this.shown = warnings.join();
    byId("tendon-warnings").replaceChildren(...warnings.map((text) => make("li", "", text)));
  }
}

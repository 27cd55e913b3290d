// The picture of a pad that moves with what is pressed: the pad's own controls, or this page's when there is no pad.

import { byId, setAttribute, setText } from "./format.js";

const STICK_REACH = 9;
const BUTTONS = {
  a: [177, 82, 7.5, "A"], b: [193, 66, 7.5, "B"], x: [161, 66, 7.5, "X"], y: [177, 50, 7.5, "Y"],
  back: [103, 55, 4.5, ""], start: [137, 55, 4.5, ""],
};
const DPAD = {
  dpad_up: "M81 86h10v10h-10z", dpad_down: "M81 106h10v10h-10z",
  dpad_left: "M71 96h10v10h-10z", dpad_right: "M91 96h10v10h-10z",
};
const SHOULDERS = { left_shoulder: ["M42 30q4-9 18-9h24v9z", "LB", 66], right_shoulder: ["M198 30q-4-9-18-9h-24v9z", "RB", 174] };

const PICTURE = `
<svg viewBox="0 0 240 152" role="img" aria-label="Pad">
  <g class="trigger"><rect x="52" y="2" width="34" height="14" rx="5"/><rect class="pull lt" x="52" y="2" width="0" height="14" rx="5"/><text x="69" y="12.500">LT</text></g>
  <g class="trigger"><rect x="154" y="2" width="34" height="14" rx="5"/><rect class="pull rt" x="154" y="2" width="0" height="14" rx="5"/><text x="171" y="12.500">RT</text></g>
  ${Object.entries(SHOULDERS).map(([name, [path, label, x]]) => `<path class="button" data-button="${name}" d="${path}"/><text x="${x}" y="28.500">${label}</text>`).join("")}
  <path class="body" d="M62 34h116c22 0 33 16 40 46 7 32 8 62-9 66-16 4-26-22-44-28H75c-18 6-28 32-44 28-17-4-16-34-9-66 7-30 18-46 40-46z"/>
  <circle class="well" cx="62" cy="66" r="18"/><circle class="well" cx="150" cy="101" r="18"/>
  <circle class="cap left" data-button="left_stick" cx="62" cy="66" r="11"/>
  <circle class="cap right" data-button="right_stick" cx="150" cy="101" r="11"/>
  ${Object.entries(DPAD).map(([name, path]) => `<path class="button" data-button="${name}" d="${path}"/>`).join("")}
  ${Object.entries(BUTTONS).map(([name, [x, y, r, label]]) => `<circle class="button" data-button="${name}" cx="${x}" cy="${y}" r="${r}"/><text x="${x}" y="${y + 3.2}">${label}</text>`).join("")}
</svg>`;

export class PadPicture {
  constructor(root) {
    root.innerHTML = PICTURE;
    root.classList.add("pad-picture");
    this.root = root;
    this.seen = "";
    this.buttons = [...root.querySelectorAll("[data-button]")];
  }

  draw(reading, held = []) {
    const pressed = new Set([...reading.buttons, ...held]);
    for (const [name, [x, y], [vx, vy]] of [["left", [62, 66], reading.left], ["right", [150, 101], reading.right]]) {
      const cap = this.root.querySelector(`.cap.${name}`);
      setAttribute(cap, "cx", (x + STICK_REACH * vx).toFixed(1));
      setAttribute(cap, "cy", (y + STICK_REACH * vy).toFixed(1));
    }
    for (const name of ["lt", "rt"]) setAttribute(this.root.querySelector(`.pull.${name}`), "width", (34 * reading[name]).toFixed(1));
    for (const button of this.buttons) button.classList.toggle("on", pressed.has(button.dataset.button));
  }

  /** `ownReading` is this page's, `ownPad` the name of the pad that drives it; `hint` says what is missing to drive. */
  show(pad, ownReading, ownPad = "", hint = "") {
    const present = !ownPad && pad.connected && pad.name !== "";
    this.draw(present ? pad.controls : ownReading, !present && ownReading.held ? ["left_shoulder"] : []);
    this.root.classList.toggle("absent", !present && !ownPad);
    if (present) this.seen = pad.name;
    const absent = this.seen ? `${this.seen} is unplugged.` : "No pad. Keys and screen drive.";
    const name = ownPad || (present ? pad.name : "");
    setText(byId("pad-name"), name ? `${name}${hint && `: ${hint}`}` : absent);
  }
}

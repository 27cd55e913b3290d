// On-screen sticks and hold buttons. The pointer is captured, so that letting go anywhere is letting go.

import { byId } from "./format.js";
import { inCircle } from "./driving.js";

/** Call `down`, `move` and `up` for one captured pointer at a time. */
function capture(element, driving, { down, move = () => {}, up }) {
  let pointer = null;
  const letGo = () => {
    if (pointer === null) return;
    const id = pointer;
    pointer = null;
    element.classList.remove("pressed");
    if (element.hasPointerCapture(id)) element.releasePointerCapture(id);
    up();
  };
  element.addEventListener("pointerdown", (event) => {
    if (pointer !== null || event.button !== 0 || !driving.enabled) return;
    event.preventDefault();
    window.focus(); // A blurred window would not hear the keys, nor the loss of its focus.
    pointer = event.pointerId;
    element.setPointerCapture(pointer);
    element.classList.add("pressed");
    down(event);
  });
  element.addEventListener("pointermove", (event) => {
    if (event.pointerId === pointer) move(event);
  });
  for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) {
    element.addEventListener(kind, (event) => {
      if (event.pointerId === pointer) letGo();
    });
  }
  element.addEventListener("contextmenu", (event) => event.preventDefault()); // a long press on a phone
  driving.letGo.push(letGo);
}

export function holdButton(id, driving) {
  const element = byId(id);
  capture(element, driving, { down: () => driving.press(id), up: () => driving.release(id) });
}

const RADIUS = 50;
const REACH = 34; // of the knob's centre, in the same units

/** A stick: x to the right, y down, −1…1 within the circle. Returns how to show a reading on it. */
export function stick(id, driving) {
  const element = byId(id);
  element.innerHTML = `
    <svg viewBox="${-RADIUS} ${-RADIUS} ${2 * RADIUS} ${2 * RADIUS}" aria-hidden="true">
      <circle class="rim" r="48"/><circle class="reach" r="${REACH}"/>
      <path class="cross" d="M0-46V-40M0 40V46M-46 0H-40M40 0H46"/>
      <line class="throw"/><circle class="knob" r="14"/>
    </svg>`;
  // Pressing grips the knob where it is, at the centre: only what is moved from there deflects it.
  let grip = [0, 0];
  capture(element, driving, {
    down: (event) => {
      grip = [event.clientX, event.clientY];
      driving.press(id, [0, 0]);
    },
    move: (event) => {
      const box = element.getBoundingClientRect();
      const scale = (box.width / 2) * (REACH / RADIUS);
      driving.press(id, inCircle((event.clientX - grip[0]) / scale, (event.clientY - grip[1]) / scale));
    },
    up: () => driving.release(id),
  });
  const knob = element.querySelector(".knob");
  const line = element.querySelector(".throw");
  return ([x, y]) => {
    knob.setAttribute("cx", x * REACH);
    knob.setAttribute("cy", y * REACH);
    line.setAttribute("x2", x * REACH);
    line.setAttribute("y2", y * REACH);
  };
}

// The keyboard: hold the space bar to drive, Escape stops. Keys typed into the panels of the 3D view do not drive.

const KEY_MAP = [
  ["Space (hold)", "drive while it is held; letting go stops"],
  ["W A S D", "bend the chosen section; W is up in the tip view"],
  ["Arrow keys", "bend the tip section"],
  ["Q  E", "twist left, right"],
  ["R  F", "feed in, out"],
  ["1 2 3 …", "choose the section"],
  ["−  +", "speed: one level down, up"],
  ["Esc", "STOP, at any time"],
  ["Tab, Enter", "go to a button of the page, press it"],
];

/** What every key does on this robot. */
export function keyMap({ limits, sections }) {
  const length = limits.length_mm && !limits.feed_mm;
  return KEY_MAP.filter(([keys]) => {
    if (keys === "Q  E") return limits.twist_deg;
    if (keys === "R  F") return limits.feed_mm || length;
    return keys !== "Arrow keys" && keys !== "1 2 3 …" || sections.length > 1;
  }).map(([keys, does]) => [keys, keys === "R  F" && length ? "lengthen, shorten the section" : does]);
}

const DRIVE_KEYS = new Set([
  "Space", "KeyW", "KeyA", "KeyS", "KeyD", "KeyQ", "KeyE", "KeyR", "KeyF",
  "ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight",
]);

/** @param on {stop(), section(index), speed(step)} */
export function listenToKeys(driving, on) {
  window.addEventListener("keydown", (event) => {
    if (event.code === "Escape") {
      if (!event.repeat) on.stop();
      return;
    }
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    if (DRIVE_KEYS.has(event.code)) {
      // The space bar has one meaning: a button that happens to have the focus is pressed with Enter only.
      if (event.code === "Space" || driving.held) event.preventDefault();
      if (!event.repeat) driving.keyDown(event.code);
    } else if (!event.repeat && /^(Digit|Numpad)[1-9]$/.test(event.code)) {
      on.section(Number(event.code.slice(-1)) - 1);
    } else if (!event.repeat && (event.key === "-" || event.key === "+" || event.key === "=")) {
      on.speed(event.key === "-" ? -1 : 1);
    }
  });
  window.addEventListener("keyup", (event) => {
    // macOS keeps the key-up of other keys to itself while Command is down.
    if (event.key === "Meta") driving.end();
    else driving.keyUp(event.code);
  }, true);
}

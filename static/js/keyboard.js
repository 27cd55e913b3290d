// The keyboard: hold the space bar to drive, Escape stops. Keys typed into the panels of the 3D view do not drive.

const DRIVE_KEYS = new Set([
  "Space", "KeyW", "KeyA", "KeyS", "KeyD", "KeyQ", "KeyE", "KeyR", "KeyF",
  "KeyC", "ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight",
]);

/** @param on {stop(), section(index), speed(step), next("mode" or "frame"), tip(), note(), acknowledge()} */
export function listenToKeys(driving, on) {
  window.addEventListener("keydown", (event) => {
    if (event.code === "Escape") {
      if (!event.repeat) on.stop();
      return;
    }
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    if (event.target.closest?.("input, select, textarea")) return; // typed there, not driven
    if (DRIVE_KEYS.has(event.code)) {
      // The space bar has one meaning: a button that happens to have the focus is pressed with Enter only.
      if (event.code === "Space" || driving.held) event.preventDefault();
      if (!event.repeat) driving.keyDown(event.code);
    } else if (!event.repeat && /^(Digit|Numpad)[1-9]$/.test(event.code)) {
      on.section(Number(event.code.slice(-1)) - 1);
    } else if (!event.repeat && (event.code === "KeyM" || event.code === "KeyV")) {
      on.next(event.code === "KeyM" ? "mode" : "frame");
    } else if (!event.repeat && (event.key === "-" || event.key === "+" || event.key === "=")) {
      on.speed(event.key === "-" ? -1 : 1);
    } else if (!event.repeat && event.code === "KeyT") {
      on.tip();
    } else if (!event.repeat && event.code === "KeyN") {
      event.preventDefault(); // the letter is not the note's first
      on.note();
    } else if (!event.repeat && event.code === "KeyK") {
      on.acknowledge();
    }
  });
  window.addEventListener("keyup", (event) => {
    // macOS keeps the key-up of other keys to itself while Command is down.
    if (event.key === "Meta") driving.end();
    else driving.keyUp(event.code);
  }, true);
}

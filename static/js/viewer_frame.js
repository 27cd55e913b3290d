// Put into viser's page by the front door, ahead of viser's own script.
(() => {
  const PANEL_FROM_PX = 640;

  /** Drawn in software, a scene takes all there is: after each slow picture it waits as long again, for the page around it. */
  function leaveRoom() {
    const SLOW_MS = 25;
    const MOST_MS = 500;
    const request = window.requestAnimationFrame.bind(window);
    const cancel = window.cancelAnimationFrame.bind(window);
    const cancels = new Map(); // what was asked for and not drawn yet: how to cancel it
    let number = 0;
    let tookMs = 0;
    window.requestAnimationFrame = (callback) => {
      const id = ++number;
      const ask = () => {
        const askedAt = performance.now();
        const frame = request((now) => {
          cancels.delete(id);
          tookMs = performance.now() - askedAt;
          callback(now);
        });
        cancels.set(id, () => cancel(frame));
      };
      if (tookMs > SLOW_MS) {
        const timer = setTimeout(ask, Math.min(tookMs, MOST_MS));
        cancels.set(id, () => clearTimeout(timer));
      } else ask();
      return id;
    };
    window.cancelAnimationFrame = (id) => {
      cancels.get(id)?.();
      cancels.delete(id);
    };
  }

  // viser shows its scene at a twentieth of its brightness until its lamps are ready: half a minute where they are drawn in
  // software, in which somebody may drive.
  const style = document.createElement("style");
  style.textContent = "canvas { opacity: 1 !important; } #webgl-software-rendering { display: none !important; }";
  document.head.append(style);

  // viser reconnects only while its document has the focus, which a frame or a wall monitor never has.
  Document.prototype.hasFocus = function () {
    return !this.hidden;
  };
  // viser's websocket goes where its page is: which view it is stands behind the #, and belongs into the path.
  if (location.hash.length > 1) {
    history.replaceState(null, "", `${location.pathname}${location.hash.slice(1)}${location.search}`);
  }
  const view = location.pathname.split("/");
  if (view.includes("plain")) leaveRoom();
  // Beside the tip's view, and on a phone, viser's panel would lie over the robot; the page around it says the same.
  const panel = ".mantine-Paper-root:not(.mantine-Modal-content, .mantine-Paper-root *)";
  const hidden = (selector) => `${selector} { display: none !important; }`;
  style.textContent += view.includes("tip") ? hidden(panel) : `@media (max-width: ${PANEL_FROM_PX}px) { ${hidden(panel)} }`;
  // Until the robot's own tabs are there, viser shows its workings.
  style.textContent += hidden(`${panel}:not(:has([role="tab"]))`);
  if (parent === window) return;

  const tell = (what) => parent.postMessage({ viewer: what }, "*");
  tell("here");

  addEventListener("keydown", (event) => {
    if (event.code === "Escape" && !event.repeat) tell("stop");
  }, true);

  // Turning the view leaves the keyboard with the operator's page, so that it goes on driving …
  addEventListener("mousedown", (event) => {
    if (event.target instanceof HTMLCanvasElement) event.preventDefault();
  }, true);
  // … and what a click took is given back, unless somebody types in a panel.
  const giveBack = () => {
    if (!document.activeElement?.matches("input, textarea, select, [contenteditable=true]")) tell("done");
  };
  addEventListener("pointerup", () => {
    tell("up");
    setTimeout(giveBack);
  }, true);
  addEventListener("focus", () => setTimeout(() => {
    if (document.activeElement === document.body) giveBack();
  }, 100));
})();

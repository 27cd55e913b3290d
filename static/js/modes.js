// The modes of motion: the chooser, one line of help or of warning, what sticks and buttons do in each, saved poses, the
// length fed by hand, and how well the body lies on its path.

import { byId, figure, make, setAttribute, setProperty, setText } from "./format.js";

const FRAMES = { world: "from behind", base: "base", tip: "tip camera" };
const FEED_WORDS = { feed: ["Feed out", "Feed in"], advance: ["Go back", "Advance"], length: ["Shorten", "Lengthen"] };
const TWIST_WORDS = { twist: ["Twist left", "Twist right"], roll: ["Roll left", "Roll right"] };
// The controls of the dock, by what a mode may do with them.
const CONTROLS = {
  left: ["stick-left"], right: ["stick-right"], twist: ["twist-left", "twist-right"], feed: ["feed-out", "feed-in"],
};
const SPEEDS = ["fine", "normal", "fast"];
const BEYOND_MM = 0.5; // less is rounding
const SOURCES = { number: "", measured: ", measured", silent: ", the measuring device is silent" };

export class Modes {
  /** @param ask (what, value, text): a request of the driver's */
  constructor(ask) {
    this.ask = ask;
    this.facts = null;
    this.shown = "";
    this.poses = "";
    byId("pose").addEventListener("change", (event) => {
      ask("pose", null, event.target.value);
      event.target.blur();
    });
    this.#dialog("save-pose", "save_pose", "pose-name");
    this.#dialog("delete-pose", "delete_pose");
    this.#dialog("hand-feed", "hand_feed", "hand-feed-length");
  }

  welcome(facts) {
    this.facts = facts;
    this.shown = this.poses = "";
    byId("modes").replaceChildren(...choice("mode", facts.modes.map((mode) => mode.title), (i) => this.ask("mode", i)));
    byId("frames").replaceChildren(...choice("frame", facts.frames.map((name) => FRAMES[name]), (i) => this.ask("frame", i)));
    byId("frames").parentElement.hidden = !facts.modes.some((mode) => mode.left);
    byId("hand-feed").hidden = !facts.hand_fed;
    this.#showControls();
  }

  /** What this robot does in no mode has no control here. */
  #showControls() {
    const middle = byId("hold").parentElement;
    for (const [what, ids] of Object.entries(CONTROLS)) {
      const never = !this.facts.modes.some((mode) => mode[what]);
      for (const id of ids) (id.startsWith("stick") ? byId(id).parentElement : byId(id)).hidden = never;
      middle.classList.toggle(`no-${what}`, never);
    }
    const choose = this.facts.bending.length > 1;
    byId("sections").parentElement.hidden = !choose;
    middle.classList.toggle("no-section", !choose);
  }

  /** Next mode or view, as the keyboard asks. */
  next(what) {
    if (!this.facts || !this.state) return;
    const names = what === "mode" ? this.facts.modes.map((mode) => mode.name) : this.facts.frames;
    this.ask(what, (names.indexOf(this.state[what]) + 1) % names.length);
  }

  /** The pose of this number in the list. */
  pose(index) {
    const name = this.state?.motion.poses[index];
    if (name !== undefined) this.ask("pose", null, name);
  }

  snapshot(state) {
    this.state = state;
    const mode = this.facts.modes.find((one) => one.name === state.mode) ?? this.facts.modes[0];
    press("modes", this.facts.modes.indexOf(mode));
    press("frames", this.facts.frames.indexOf(state.frame));
    if (this.shown !== mode.name) this.#show(mode);
    if (mode.name === "section" && mode.left) setText(byId("stick-left-name"), this.facts.sections[state.section] ?? "section");
    this.#say(mode, state);
    this.#showPath(state.motion.path);
    this.#showPoses(state.motion);
    this.#showHandFeed(state.motion.hand_feed);
  }

  /** What sticks, buttons, pad and keys do in this mode. */
  #show(mode) {
    this.shown = mode.name;
    document.body.dataset.mode = mode.name;
    const section = mode.name === "section";
    nameStick("left", section && mode.left ? "Bend" : "", section ? "section" : mode.left, mode.left);
    nameStick("right", section && mode.right ? "Bend" : "", section ? this.facts.sections[this.facts.bending.at(-1)] : mode.right, mode.right);
    byId("stick-left").classList.toggle("unused", !mode.left);
    byId("stick-right").classList.toggle("unused", !mode.right);
    const [out, inwards] = FEED_WORDS[mode.feed || this.#elsewhere("feed")] ?? FEED_WORDS.feed;
    const [left, right] = TWIST_WORDS[mode.twist || this.#elsewhere("twist")] ?? TWIST_WORDS.twist;
    const words = { "feed-out": out, "feed-in": inwards, "twist-left": left, "twist-right": right };
    for (const [id, word] of Object.entries(words)) {
      setText(byId(id).querySelector("span"), word);
      byId(id).classList.toggle("unused", !mode[id.split("-")[0]]);
    }
    byId("sections").parentElement.classList.toggle("unused", !section);
    byId("pad-map").replaceChildren(...mode.lines.map((line) => row(line.pad, line.does)));
    const keys = mode.lines.filter((line) => line.keys).map((line) => row(line.keys, line.does));
    byId("key-map").replaceChildren(...keys, row("T  N  K", "tip view; a note or a mark; alarms are seen"), row("Tab, Enter", "go to a button of the page, press it"));
  }

  /** What a control does in the first mode that has a use for it: its name where it has none. */
  #elsewhere(what) {
    return this.facts.modes.find((mode) => mode[what])?.[what];
  }

  /** One line: what is wrong before what binds, before what the mode is for. */
  #say(mode, state) {
    const beyond = this.facts.active_length_mm === null ? 0 : state.feed_mm - this.facts.active_length_mm;
    const going = ["straighten", "pose"].includes(state.mode);
    const warnings = going ? [] : [...state.motion.words];
    if (beyond > BEYOND_MM) {
      warnings.unshift(`${figure(beyond)} mm of the passive body are outside: they go straight, or where the surroundings guide them`);
    }
    const said = [...(going ? state.motion.words : []), ...warnings].map((words) => `${capital(words)}.`);
    const line = byId("mode-help");
    const text = warnings.length ? said.join(" ") : [...said, mode.help].join(" ");
    setText(line, text);
    setProperty(line, "title", text);
    line.classList.toggle("warning", warnings.length > 0);
  }

  #showPath(path) {
    setProperty(byId("path"), "hidden", !path);
    if (!path) return;
    setText(byId("deviation"), `${figure(path.deviation_mm, 1, 4)} mm`);
    setText(byId("deviation-max"), `${figure(path.deviation_max_mm, 1, 4)} mm`);
  }

  #showPoses(motion) {
    setProperty(byId("poses"), "hidden", this.state.mode !== "pose");
    const key = JSON.stringify(motion.poses);
    if (key !== this.poses) {
      this.poses = key;
      const first = make("option", "", motion.poses.length ? "choose a pose" : "no pose is saved");
      first.value = "";
      byId("pose").replaceChildren(first, ...motion.poses.map((name) => make("option", "", name)));
      byId("known-poses").replaceChildren(...motion.poses.map((name) => Object.assign(make("option"), { value: name })));
    }
    if (document.activeElement !== byId("pose")) byId("pose").value = motion.pose;
    setProperty(byId("delete-pose"), "disabled", !motion.pose);
    setText(byId("delete-pose-name"), motion.pose);
  }

  #showHandFeed(fed) {
    if (!fed) return;
    const waits = Math.abs(fed.told_mm - fed.used_mm) > BEYOND_MM;
    const button = byId("hand-feed");
    setText(button, `Fed by hand: ${figure(fed.used_mm)}${waits ? `, told ${figure(fed.told_mm)}` : ""} mm${SOURCES[fed.source]}`);
    button.title = waits ? `Told ${figure(fed.told_mm)} mm: it is taken in while you hold to drive` : "";
  }

  /** A button that opens its dialog; confirmed, it asks for `what` with the text of `input`. */
  #dialog(button, what, input) {
    const dialog = byId(`${button}-dialog`);
    byId(button).addEventListener("click", () => {
      if (input) byId(input).value = input === "hand-feed-length" ? Math.round(this.state.motion.hand_feed.used_mm) : this.state.motion.pose;
      dialog.showModal();
      if (input) byId(input).select();
    });
    dialog.addEventListener("close", () => {
      const text = input ? byId(input).value : this.state.motion.pose;
      if (dialog.returnValue === "yes") this.ask(what, null, text);
      dialog.returnValue = "";
      document.activeElement?.blur();
    });
  }
}

/** "fine 25 %" … for three levels, else the share alone. */
export function speedLabels(levels) {
  return levels.map((level, i) => `${levels.length === SPEEDS.length ? `${SPEEDS[i]} ` : ""}${figure(100 * level)} %`);
}

/** Buttons of which one is chosen. */
export function choice(kind, labels, choose) {
  return labels.map((label, i) => {
    const button = make("button", "", label);
    button.type = "button";
    button.dataset.testid = `${kind}-${i + 1}`;
    button.addEventListener("click", () => choose(i));
    return button;
  });
}

/** Show which of a list of buttons is chosen. */
export function press(id, index) {
  [...byId(id).children].forEach((button, i) => setAttribute(button, "aria-pressed", i === index));
}

function nameStick(side, verb, name, used = name) {
  const label = byId(`stick-${side}-name`);
  setText(label, used ? name : "not used");
  setText(label.previousElementSibling, verb);
}

function row(control, does) {
  return make("div", "", make("dt", "", control), make("dd", "", does));
}

function capital(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

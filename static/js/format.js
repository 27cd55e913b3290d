// Numbers and words for people: fixed widths, true minus signs, a dash for what is not known.

/** The folder this page lies in, to which its sockets and view belong: a console that watches has one page a robot. */
export const PLACE = location.pathname.replace(/[^/]*$/, "");

export const DASH = "–";
const FIGURE_SPACE = "\u2007";

/** A number with a fixed count of decimals, padded to `width` so that nothing beside it moves. */
export function figure(value, decimals = 0, width = 0) {
  if (!Number.isFinite(value)) return DASH.padStart(width, FIGURE_SPACE);
  const rounded = value.toFixed(decimals);
  const text = Number(rounded) === 0 ? rounded.replace("-", "") : rounded.replace("-", "−");
  return text.padStart(width, FIGURE_SPACE);
}

/** Seconds ago, in the unit that fits. */
export function ago(seconds) {
  if (!Number.isFinite(seconds)) return DASH;
  if (seconds < 90) return `${Math.max(0, Math.round(seconds))} s`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`;
  return `${Math.round(seconds / 3600)} h`;
}

/** Write only what changed: most of the page stands still most of the time. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** As `setText`, for an attribute. */
export function setAttribute(element, name, value) {
  const text = String(value);
  if (element.getAttribute(name) !== text) element.setAttribute(name, text);
}

/** As `setText`, for a property such as hidden or disabled. */
export function setProperty(element, name, value) {
  if (element[name] !== value) element[name] = value;
}

/** As `setText`, for a style; the element remembers, as browsers write values their own way. */
export function setStyle(element, name, value) {
  element.shown ??= {};
  if (element.shown[name] === value) return;
  element.shown[name] = value;
  element.style[name] = value;
}

export function byId(id) {
  return document.getElementById(id);
}

/** An element with a class, text and children. */
export function make(tag, className = "", ...children) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  element.append(...children);
  return element;
}

/** Show `rows` (strings, or [class, text]) as the items of a list, touching it only when they changed. */
export function setList(list, rows) {
  const key = JSON.stringify(rows);
  if (list.dataset.rows === key) return;
  list.dataset.rows = key;
  list.replaceChildren(
    ...rows.map((row) => (Array.isArray(row) ? make("li", row[0], row[1]) : make("li", "", row))),
  );
}

// Create elements. Data always becomes text: nothing from a study is parsed as HTML.

export const $ = (id) => document.getElementById(id);

export function el(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === null || value === undefined || value === false) continue;
    if (name === "on") {
      for (const [event, handler] of Object.entries(value)) made.addEventListener(event, handler);
    } else if (name === "data") Object.assign(made.dataset, value);
    else made.setAttribute(name, value === true ? "" : String(value));
  }
  made.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined));
  return made;
}

export function fill(parent, ...children) {
  parent.replaceChildren(...children.flat(Infinity).filter((child) => child !== null && child !== undefined));
}

export const button = (words, run, properties = {}) =>
  el("button", { type: "button", ...properties, on: { click: run } }, words);

// Return a table. `rows` are lists of cells, the first of which is the row's heading, or objects of
// `cells`, `kind` (a class) and `title`. `kinds` are the classes of the columns; with a `label`, a
// table that is too wide scrolls in a region of that name.
export function table(heads, rows, { kinds = [], label = "", ...properties } = {}) {
  const body = rows.map((row) => {
    const { cells, kind, title } = Array.isArray(row) ? { cells: row } : row;
    return el("tr", { class: kind }, cells.map((content, k) => (k ? el("td", { class: kinds[k] }, content)
      : el("th", { scope: "row", class: kinds[k], title }, content))));
  });
  const head = heads && el("thead", {}, el("tr", {}, heads.map((text, k) => el("th", { scope: "col", class: kinds[k] }, text))));
  const made = el("table", properties, head, el("tbody", {}, body));
  return el("div", { class: "scroll", ...(label && { tabindex: "0", role: "region", "aria-label": label }) }, made);
}

// Return the sign of an objective that is met or missed, and the words of it for screen readers.
export const verdict = (met) => (typeof met !== "boolean" ? null : [el("span", { "aria-hidden": "true", class: met ? "yes" : "no" }, met ? " ✓" : " ✗"),
  el("span", { class: "hidden" }, ` (objective ${met ? "met" : "missed"})`)]);

// Return a table of the server's view, with the unit at each value.
export const shownTable = ({ label, columns, rows }) => table(columns.map(({ name }) => name), rows.map(({ name, aim, about, unit, cells }) => ({
  title: about || null, cells: [[symbol(name), aim ? el("small", { class: "faint" }, ` (${together(aim)})`) : null],
    ...cells.map(({ text, met, kind }) => el("span", { class: kind.split(" ").at(-1) }, withUnit(text, unit), verdict(met) ?? []))] })),
{ label, class: "kpi-table", kinds: ["", ...columns.slice(1).map(({ kind }) => (kind === "words" ? "" : "number"))] });

// Return what is closed at first; it stays as the person left it while the page is drawn anew.
export const folded = (id, summary, ...parts) => el("details", { id, open: $(id)?.open }, el("summary", {}, summary), ...parts);

export const counted = (count, noun) => `${count} ${noun}${count === 1 ? "" : "s"}`;

// Return names with their values, large: θ of an experiment.
export const values = (knobs, kind = "") => el("dl", { class: `values ${kind}` }, knobs.map(({ name, text, unit, title }) =>
  el("div", { title }, el("dt", {}, symbol(name)), el("dd", {}, withUnit(text, unit)))));

// Return text in which no line ends between a number and its unit: one letter, or a word that is no plain one; see `symbols_in`.
const UNIT = /(\d) (?=[a-z]?[^a-z\d\s(-]|[a-z](?![a-z])|[a-z]+[A-Z/²³·]|(?:min|ms|mm|cm|km|kg|rad|rpm|bar|mol)\b)|([≤≥]) (?=[−\d])/g;
const together = (text) => text.replace(UNIT, "$1$2\u00a0");

// Return C_A with a subscript, and numbers with their units; T_s=0.5 in a command, and "M_s" between quotes, stay as they are typed.
export function symbol(text) {
  const parts = together(text).split(/_([\p{L}\p{N}_]+)(?![\p{L}\p{N}_="])/u);
  return parts.map((part, i) => (i % 2 ? el("sub", {}, part.replaceAll("_", " ")) : part));
}

export const withUnit = (text, unit) => (unit && /[0-9]$/.test(text) ? `${text}\u00a0${unit}` : text);

const colors = new Map();
export const DARK = matchMedia("(prefers-color-scheme: dark)"); // views that draw in colors listen to it
DARK.addEventListener("change", () => colors.clear());

// Return a color of the style sheet, read once per theme because reading triggers a layout.
export function css(name) {
  if (!colors.has(name)) colors.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return colors.get(name);
}

// The namespace of SVG, read from the parser so that a page without network has no web address.
const SVG = new DOMParser().parseFromString("<svg></svg>", "text/html").querySelector("svg").namespaceURI;

export function svg(tag, properties = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(properties)) made.setAttribute(name, String(value));
  made.append(...children);
  return made;
}

// Remember a text in the browser; without storage it is forgotten, and `kept` returns null.
export function keep(key, text, storage = "localStorage") {
  try {
    globalThis[storage].setItem(key, text);
  } catch {
    // No storage.
  }
}

export function kept(key, storage = "localStorage") {
  try {
    return globalThis[storage].getItem(key);
  } catch {
    return null;
  }
}

export function say(text) {
  // Empty it first, so that screen readers read the same words again.
  $("status").textContent = "";
  requestAnimationFrame(() => ($("status").textContent = text));
}

// Return a button that copies `text`.
export const copying = (text, words = "Copy") => button(words, async ({ target }) => {
  try {
    await navigator.clipboard.writeText(text);
    target.textContent = "Copied";
    say("Copied");
  } catch {
    target.textContent = "Select and copy it yourself";
  }
});

export function ask(title, text, actions, kind = "") {
  const dialog = $("dialog");
  dialog.className = kind;
  const buttons = actions.map(([words, act, kind = ""]) => button(words, () => {
    dialog.close();
    act?.();
  }, { class: kind }));
  fill(dialog, el("h2", { id: "dialog-title", tabindex: "-1" }, title), ...[text].flat(),
    el("p", { class: "actions" }, buttons));
  dialog.showModal();
  if (kind) $("dialog-title").focus(); // show a long dialog from its top, not from its buttons
}

export function when(iso) {
  const date = new Date(iso);
  return Number.isNaN(date.getTime()) ? iso : date.toLocaleString("sv-SE",
    { dateStyle: "short", timeStyle: "short" }); // year, month, day: clear in every country
}

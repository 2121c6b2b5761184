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
  made.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return made;
}

export function fill(parent, ...children) {
  parent.replaceChildren(...children.flat().filter((child) => child !== null));
}

// Return "C_A" with a subscript.
export function symbol(text) {
  const parts = text.split(/_([\p{L}\p{N}_]+)/u);
  return parts.map((part, i) => (i % 2 ? el("sub", {}, part.replaceAll("_", " ")) : part));
}

export function withUnit(text, unit) {
  return unit && /[0-9]$/.test(text) ? `${text} ${unit}` : text;
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

export async function copied(text, button) {
  try {
    await navigator.clipboard.writeText(text);
    button.textContent = "Copied";
    say("Copied");
  } catch {
    button.textContent = "Select and copy it yourself";
  }
}

export function ask(title, text, actions, kind = "") {
  const dialog = $("dialog");
  dialog.className = kind;
  const buttons = actions.map(([words, act, kind]) =>
    el("button", { type: "button", class: kind ?? "", on: { click: () => {
      dialog.close();
      act?.();
    } } }, words));
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

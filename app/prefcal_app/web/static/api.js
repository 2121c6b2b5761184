// Send requests to the server; refusals become errors.

import { el, fill } from "./dom.js";

export class Refusal extends Error {
  constructor(status, body) {
    super(body?.error ?? `The server answered ${status}.`);
    this.status = status;
    this.kind = body?.kind ?? "";
    this.now = body?.now ?? null;
  }
}

async function result(response) {
  let body = null;
  try {
    body = await response.json();
  } catch {
    // Not JSON: a proxy answered, or the server is shutting down.
  }
  if (!response.ok) throw new Refusal(response.status, body);
  return body;
}

const flag = (blind) => `blind=${blind ? 1 : 0}`;

export async function get(path) {
  return result(await fetch(path, { cache: "no-store" }));
}

// Return the answer; if there is none, say so in `place` and return null.
export async function fetched(place, path) {
  try {
    return await get(path);
  } catch (error) {
    fill(place, el("p", { class: "problem", role: "alert" }, error.message));
    return null;
  }
}

// Fill a view with what `draw` returns of the answer, below its title; until then with what is there.
export async function load(view, title, path, draw) {
  if (!view.firstChild) fill(view, title, el("p", {}, "Loading…"));
  const place = el("div", {});
  const found = await fetched(place, path);
  fill(view, title, found ? draw(found) : place);
}

export async function post(name, fields, blind) {
  return result(await fetch(`/api/${name}?${flag(blind)}`, {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify(fields),
  }));
}

// Send a record. `where` is "preview", which saves nothing, or "record".
export async function sendRecord(where, { index, unsafe, again, theta }, content, blind) {
  const set = theta ? `&theta=${encodeURIComponent(theta.join(","))}` : "";
  const query = `index=${index}&unsafe=${unsafe ? 1 : 0}&again=${again ? 1 : 0}${set}&${flag(blind)}`;
  return result(await fetch(`/api/${where}?${query}`, {
    method: "POST",
    headers: { "Content-Type": "text/csv" },
    body: content,
  }));
}

// Wait until the server has a newer version than `version`, and return it.
export async function news(version, blind, signal) {
  const after = version === null ? "" : `after=${version}&`;
  return result(await fetch(`/api/now?${after}${flag(blind)}`, { cache: "no-store", signal }));
}

// Keep the comment on the open question while it is typed, so that a reload does not lose it.

import { $, keep as store, kept } from "./dom.js";

const KEY = "prefcal-comment";
let subject = "";

export function start() {
  $("comment").addEventListener("input", keep);
}

function keep() {
  store(KEY, JSON.stringify({ subject, text: $("comment").value }), "sessionStorage");
}

// Show what was typed about this question before a reload; what is in the field stays there.
export function restore({ study, question }) {
  subject = `${study.place} ${question.id}`;
  try {
    const last = JSON.parse(kept(KEY, "sessionStorage"));
    if (last?.subject === subject) $("comment").value ||= last.text;
  } catch {
    // Nothing of ours.
  }
}

// Return the comment and empty the field.
export function take() {
  const text = $("comment").value;
  put("");
  return text;
}

export function put(text) {
  $("comment").value = text;
  keep();
}

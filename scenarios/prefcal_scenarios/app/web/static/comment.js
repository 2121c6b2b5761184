// Keep the comment on the open question while it is typed, so that a reload does not lose it.

import { $ } from "./dom.js";

const KEY = "prefcal-comment";
let subject = "";

export function start() {
  $("comment").addEventListener("input", keep);
}

function keep() {
  try {
    sessionStorage.setItem(KEY, JSON.stringify({ subject, text: $("comment").value }));
  } catch {
    // No storage: it is lost with the page.
  }
}

// Show what was typed about this question before a reload; what is in the field stays there.
export function restore({ study, question }) {
  subject = `${study.place} ${question.id}`;
  try {
    const kept = JSON.parse(sessionStorage.getItem(KEY));
    if (kept?.subject === subject) $("comment").value ||= kept.text;
  } catch {
    // No storage, or nothing of ours in it.
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

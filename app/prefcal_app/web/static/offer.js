// Show why the open question is asked, and offer to stop where that is worth considering.

import { $, fill, symbol } from "./dom.js";

let declined = false; // the person goes on: the same offer is not made again

export function start(act) {
  $("offer-finish").addEventListener("click", () => act("finish", {}));
  $("offer-go-on").addEventListener("click", () => {
    declined = true;
    $("offer").hidden = true;
    dispatchEvent(new Event("resize")); // the curves fill the remaining space
    $("verdict-left").focus();
  });
}

export function show({ blind, good_enough: good, question, screening }) {
  const words = [];
  if (good) words.push(`You marked ${good.number ? `experiment ${good.number}, the` : "the"} best so far, as good enough.`);
  const unlikely = declined ? "" : screening?.offer ?? "";
  if (unlikely) words.push(unlikely);
  $("offer").hidden = !words.length;
  $("offer-text").textContent = words.join(" ");
  $("offer-go-on").hidden = !unlikely;
  // Its place is kept while the reason is worked out, so that nothing moves when it comes.
  $("why").hidden = !screening || blind || question.repeat;
  fill($("why"), symbol(screening?.why || "\u00a0"));
}

// Animate both experiments on one clock.

import { $, el } from "./dom.js";
import { Player, Road } from "./road.js";

const VIEW = { behind: 24, seen: 60, below: 0.6, marks: false };

export class Scenes {
  #told;
  #player;

  constructor(told) {
    this.#told = told;
  }

  start() {
    const controls = { button: $("play"), range: $("scrub"), output: $("clock-text") };
    this.#player = new Player(controls, this.#told);
    // Drop the focus after scrubbing, so that arrow keys give answers again.
    $("scrub").addEventListener("pointerup", (event) => event.target.blur());
  }

  take(question) {
    const roads = ["left", "right"].filter((name) => $(`${name}-scene`)).map((name) => road(name, question)).filter(Boolean);
    $("clock").hidden = !roads.length;
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.#player.take(roads, still ? 0.5 * Math.max(...roads.map(({ end }) => end), 0) : 0);
  }

  // Move the scenes to the cursor's time.
  follow(time) {
    this.#player.follow(time);
  }

  toggle() {
    this.#player.toggle();
  }
}

// Return the road of one side, or null without a record; the earlier scene is removed either way.
function road(name, question) {
  const box = $(`${name}-scene`), { scene } = question[name];
  box.replaceChildren();
  if (!scene?.rows?.length) return null;
  const now = el("span", { class: "now" });
  const made = new Road(box, scene, VIEW, now);
  box.append(now);
  return made;
}

// The overtaking from above: both scenes on one clock, to be played, paused and scrubbed.

import { css } from "./bounds.js";
import { $ } from "./dom.js";

const BEHIND = 24, SEEN = 60; // m behind the front end, and in all

export class Scenes {
  #told;
  #question = null;
  #time = 0;
  #before = null; // when the last frame was drawn, while it plays

  constructor(told) {
    this.#told = told;
  }

  start() {
    $("play").addEventListener("click", () => this.toggle());
    $("scrub").addEventListener("input", (event) => {
      this.#stop();
      this.#to(Number(event.target.value));
    });
    // Left alone after scrubbing, so that arrow keys answer again.
    $("scrub").addEventListener("pointerup", (event) => event.target.blur());
  }

  get #scenes() {
    return ["left", "right"].map((name) => [name, this.#question?.[name].scene])
      .filter(([, scene]) => scene?.rows?.length);
  }

  get #end() {
    return Math.max(...this.#scenes.map(([, scene]) => scene.end), 0);
  }

  take(question) {
    this.#stop();
    this.#question = question;
    $("clock").hidden = !question.has_scene || !this.#scenes.length;
    if ($("clock").hidden) return;
    $("scrub").max = this.#end;
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.#to(still ? 0.5 * this.#end : 0, false);
  }

  // The cursor was moved: the scenes follow it.
  follow(time) {
    if ($("clock").hidden || this.#before !== null) return;
    this.#time = Math.min(Math.max(time, 0), this.#end);
    this.draw();
  }

  toggle() {
    if ($("clock").hidden) return;
    if (this.#before !== null) return this.#stop();
    if (this.#time >= this.#end - 1e-6) this.#time = 0;
    this.#before = performance.now();
    this.#label(true);
    requestAnimationFrame((now) => this.#frame(now));
  }

  #stop() {
    this.#before = null;
    this.#label(false);
  }

  #label(playing) {
    $("play").firstElementChild.textContent = playing ? "❚❚" : "▶";
    $("play").setAttribute("aria-label", playing ? "Pause" : "Play");
  }

  #frame(now) {
    if (this.#before === null) return;
    this.#to(Math.min(this.#time + Math.max(now - this.#before, 0) / 1000, this.#end));
    this.#before = now;
    if (this.#time >= this.#end) this.#stop();
    else requestAnimationFrame((next) => this.#frame(next));
  }

  #to(time, tell = true) {
    this.#time = time;
    this.draw();
    if (tell) this.#told(time);
  }

  draw() {
    if ($("clock").hidden) return;
    $("scrub").value = this.#time;
    $("scrub").setAttribute("aria-valuetext", `${this.#time.toFixed(1)} s`);
    $("clock-text").textContent = `${this.#time.toFixed(1)} s of ${this.#end.toFixed(0)} s`;
    for (const [name, scene] of this.#scenes) {
      const canvas = $(`${name}-scene`);
      if (canvas?.clientWidth) paint(canvas, scene, this.#time, css(`--${name}`));
    }
  }
}

// Positions at `time`, linear between the rows.
function row(scene, time) {
  const last = scene.rows.length - 1;
  const at = Math.min(time, scene.end);
  const i = Math.min(Math.floor(at / scene.step + 1e-9), last - 1);
  if (i < 0) return scene.rows[0];
  const to = i + 1 === last ? scene.end : (i + 1) * scene.step;
  const share = (at - i * scene.step) / (to - i * scene.step);
  return scene.rows[i].map((value, k) => value + share * (scene.rows[i + 1][k] - value));
}

function paint(canvas, scene, time, color) {
  const ratio = devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== width * ratio) [canvas.width, canvas.height] = [width * ratio, height * ratio];
  const g = canvas.getContext("2d");
  const [low, high] = scene.road;
  const scale = Math.min(width / SEEN, height / (high - low + 1.2));
  const [x, y, heading, speed, ...others] = row(scene, time);
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.fillStyle = css("--verge");
  g.fillRect(0, 0, width, height);
  // World: x forward from the car, y to the left, in metres.
  g.translate((width * BEHIND) / SEEN, height / 2);
  g.scale(scale, -scale);
  g.translate(-x, -(low + high) / 2);
  const from = x - width / scale, to = x + width / scale;
  g.fillStyle = css("--asphalt");
  g.fillRect(from, low, to - from, high - low);
  line(g, css("--paint"), 0.16, [], [[from, low + 0.2], [to, low + 0.2]]);
  line(g, css("--paint"), 0.16, [], [[from, high - 0.2], [to, high - 0.2]]);
  for (let y = low + scene.lane; y < high - scene.lane / 2; y += scene.lane)
    line(g, css("--paint"), 0.14, [3, 4.5], [[Math.floor(from / 7.5) * 7.5, y], [to, y]]);
  line(g, color, 0.22, [], scene.rows.slice(0, Math.floor(time / scene.step) + 1).concat([[x, y]]));
  for (let k = 0; k < others.length; k += 2) car(g, scene.size, others[k], others[k + 1], 0, css("--other"));
  car(g, scene.size, x, y, heading, color);
  caption(g, ratio, width, scene, time, speed);
}

function line(g, color, width, dash, points) {
  g.strokeStyle = color;
  g.lineWidth = width;
  g.setLineDash(dash);
  g.beginPath();
  points.forEach(([x, y], k) => (k ? g.lineTo(x, y) : g.moveTo(x, y)));
  g.stroke();
  g.setLineDash([]);
}

// Front end at (x, y), drawn to scale.
function car(g, [length, width], x, y, heading, color) {
  g.save();
  g.translate(x, y);
  g.rotate((heading * Math.PI) / 180);
  g.fillStyle = color;
  g.beginPath();
  g.roundRect(-length, -width / 2, length, width, 0.35);
  g.fill();
  g.fillStyle = "rgba(255,255,255,.75)";
  g.fillRect(-0.42 * length, -0.36 * width, 0.13 * length, 0.72 * width);
  g.fillRect(-0.9 * length, -0.32 * width, 0.07 * length, 0.64 * width);
  g.restore();
}

function caption(g, ratio, width, scene, time, speed) {
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.font = "12px system-ui, sans-serif";
  g.fillStyle = css("--paint");
  const stopped = scene.stopped && time >= scene.end;
  g.fillText(stopped ? `stopped at ${scene.end.toFixed(1)} s` : `${speed.toFixed(0)} km/h`, 8, 26);
}

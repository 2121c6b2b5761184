(() => {
  "use strict";
  const BEHIND = 42;
  const player = document.querySelector(".player");
  const data = JSON.parse(player.querySelector("script").textContent);
  const button = player.querySelector("button");
  const range = player.querySelector("input");
  const output = player.querySelector("output");
  const scenes = [...player.querySelectorAll(".run")].map((run, i) => ({
    ...data.runs[i],
    world: run.querySelector(".world"),
    own: run.querySelector(".own"),
    others: [...run.querySelectorAll(".other")],
    now: run.querySelector(".now"),
  }));
  const end = Math.max(...scenes.map((scene) => scene.end));
  let time = data.still;
  let before = null; // when the last frame was drawn, while it plays

  function row(scene) {
    const at = Math.min(time, scene.end);
    const last = scene.rows.length - 1;
    const i = Math.min(Math.floor(at / data.step + 1e-9), last - 1);
    const from = i * data.step;
    const to = i + 1 === last ? scene.end : from + data.step;
    const share = (at - from) / (to - from);
    return scene.rows[i].map((value, k) => value + share * (scene.rows[i + 1][k] - value));
  }

  function draw() {
    for (const scene of scenes) {
      const [x, y, heading, speed, ...others] = row(scene);
      scene.world.setAttribute("transform", `translate(${BEHIND - x} 0)`);
      scene.own.setAttribute("transform", `translate(${x} ${-y}) rotate(${-heading})`);
      scene.others.forEach((other, i) => {
        other.setAttribute("transform", `translate(${others[2 * i]} ${-others[2 * i + 1]})`);
      });
      const stopped = scene.stopped && time >= scene.end;
      const when = stopped ? `stopped at ${scene.end.toFixed(1)} s, ` : "";
      scene.now.textContent = `${when}${speed.toFixed(0)} km/h`;
    }
    range.value = String(time);
    const text = `${time.toFixed(1)} s`;
    range.setAttribute("aria-valuetext", text);
    output.textContent = text;
  }

  function show(playing) {
    button.textContent = playing ? "❚❚" : "▶";
    button.setAttribute("aria-label", playing ? "Pause" : "Play");
  }

  function pause() {
    before = null;
    show(false);
  }

  function frame(now) {
    if (before === null) return;
    time = Math.min(time + Math.max(now - before, 0) / 1000, end);
    before = now;
    draw();
    if (time >= end) pause();
    else requestAnimationFrame(frame);
  }

  button.addEventListener("click", () => {
    if (before !== null) return pause();
    if (time >= end || !player.dataset.played) time = 0;
    player.dataset.played = "yes";
    before = performance.now();
    show(true);
    requestAnimationFrame(frame);
  });
  range.addEventListener("input", () => {
    pause();
    player.dataset.played = "yes";
    time = Number(range.value);
    draw();
  });
  player.querySelector(".controls").hidden = false;
  draw();
})();

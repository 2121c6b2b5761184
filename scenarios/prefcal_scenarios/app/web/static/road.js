// Draw an overtaking seen from above as SVG, with one clock for several roads. The query window
// imports this file and reports contain a copy of it, so it imports nothing.

// The namespace of SVG, read from the parser so that a page without network has no web address.
const SVG = new DOMParser().parseFromString("<svg></svg>", "text/html").querySelector("svg").namespaceURI;

export function svg(tag, properties = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(properties)) made.setAttribute(name, String(value));
  made.append(...children);
  return made;
}

const flat = (points) => points.map(([x, y]) => `${x},${y}`).join(" ");

function vehicle(role, body) {
  return svg("g", { class: role }, ...body.map((part) => svg("polygon", { class: part.role, points: flat(part.points) })));
}

// One run drawn in `box`. `drawing` comes from prefcal_scenarios.cases.overtake.pictures.drawing: x forward, y to
// the left, in meters. `view` says how many meters are visible: behind the front end, in total, and
// below the road. The element `now` shows the speed.
export class Road {
  constructor(box, drawing, view, now) {
    Object.assign(this, { drawing, view, now });
    const [low, high] = drawing.road;
    this.trace = svg("polyline", { class: "trace" });
    this.others = this.#row(0).slice(4).filter((_, k) => k % 3 === 0).map(() => vehicle("other", drawing.body));
    this.own = vehicle("own", drawing.body);
    const upward = svg("g", { transform: "scale(1 -1)" }, ...this.#ground(),
      svg("polyline", { class: "path", points: flat(drawing.rows) }), this.trace, ...this.others, this.own);
    this.world = svg("g", {}, upward, ...(view.marks ? this.#marks() : []));
    box.replaceChildren(svg("svg", { viewBox: `${-view.behind} ${-high - 0.6} ${view.seen} ${high - low + 0.6 + view.below}`,
      "aria-hidden": "true" }, this.world));
  }

  get end() {
    return this.drawing.end;
  }

  // Return the first and last x of the road, beyond what any screen shows.
  get #reach() {
    return [-600, 600 + Math.max(...this.drawing.rows.map(([x]) => x))];
  }

  #ground() {
    const { road: [low, high], lines, dash } = this.drawing, [from, to] = this.#reach;
    const start = Math.floor(from / (dash[0] + dash[1])) * (dash[0] + dash[1]); // dashes start at multiples of the period
    return [
      svg("rect", { class: "asphalt", x: from, y: low, width: to - from, height: high - low }),
      ...[low, high].map((y) => svg("path", { class: "paint", d: `M${from} ${y}H${to}` })),
      ...lines.map((y) => svg("path", { class: "paint", d: `M${start} ${y}H${to}`, "stroke-dasharray": dash.join(" ") })),
    ];
  }

  // Return the distance marks, outside the flipped group so that their text is upright.
  #marks() {
    const { road: [low], every } = this.drawing, [, to] = this.#reach;
    const found = [];
    for (let x = -100; x < to; x += every) {
      const text = svg("text", { x, y: -low + 2 });
      text.textContent = `${x} m`.replace("-", "−");
      found.push(svg("path", { class: "paint", d: `M${x} ${-low}v0.4` }), text);
    }
    return found;
  }

  // Return all positions at `time`, linear between the rows.
  #row(time) {
    const { rows, step, end } = this.drawing, last = rows.length - 1;
    const at = Math.min(time, end);
    const i = Math.min(Math.floor(at / step + 1e-9), last - 1);
    if (i < 0) return rows[0];
    const to = i + 1 === last ? end : (i + 1) * step;
    const share = (at - i * step) / (to - i * step);
    return rows[i].map((value, k) => value + share * (rows[i + 1][k] - value));
  }

  show(time) {
    const { rows, step, stopped, end } = this.drawing;
    const [x, y, heading, speed, ...others] = this.#row(time);
    const place = (element, x, y, heading) =>
      element.setAttribute("transform", `translate(${x} ${y}) rotate(${heading})`);
    this.world.setAttribute("transform", `translate(${-x} 0)`);
    place(this.own, x, y, heading);
    this.others.forEach((other, k) => place(other, ...others.slice(3 * k, 3 * k + 3)));
    this.trace.setAttribute("points", flat([...rows.slice(0, Math.floor(time / step) + 1), [x, y]]));
    const over = stopped && time >= end;
    this.now.textContent = over ? `stopped at ${end.toFixed(1)} s` : `${speed.toFixed(0)} km/h`;
  }
}

// A player for several roads on one clock; it calls `told` with every time but the first.
export class Player {
  #controls;
  #told;
  #roads = [];
  #time = 0;
  #before = null; // time of the last frame while playing
  #fresh = true; // no time was chosen yet, so it plays from the start

  constructor(controls, told = () => {}) {
    this.#controls = controls;
    this.#told = told;
    controls.button.addEventListener("click", () => this.toggle());
    controls.range.addEventListener("input", (event) => {
      this.#stop();
      this.#to(Number(event.target.value));
    });
  }

  get #end() {
    return Math.max(...this.#roads.map((road) => road.end), 0);
  }

  // Show other roads at `time`.
  take(roads, time) {
    this.#stop();
    this.#roads = roads;
    this.#controls.range.max = this.#end;
    this.#to(time, false);
    this.#fresh = true;
  }

  // Show another time, unless it is playing.
  follow(time) {
    if (this.#before === null) this.#to(Math.min(Math.max(time, 0), this.#end), false);
  }

  toggle() {
    if (!this.#roads.length) return;
    if (this.#before !== null) return this.#stop();
    if (this.#fresh || this.#time >= this.#end - 1e-6) this.#time = 0;
    this.#before = performance.now();
    this.#label(true);
    requestAnimationFrame((now) => this.#frame(now));
  }

  #stop() {
    this.#before = null;
    this.#label(false);
  }

  #label(playing) {
    const { button } = this.#controls;
    button.firstElementChild.textContent = playing ? "❚❚" : "▶";
    button.setAttribute("aria-label", playing ? "Pause" : "Play");
  }

  #frame(now) {
    if (this.#before === null) return;
    this.#to(Math.min(this.#time + Math.max(now - this.#before, 0) / 1000, this.#end));
    this.#before = now;
    if (this.#time >= this.#end) this.#stop();
    else requestAnimationFrame((next) => this.#frame(next));
  }

  #to(time, tell = true) {
    const { range, output } = this.#controls;
    this.#time = time;
    this.#fresh = false;
    range.value = time;
    range.setAttribute("aria-valuetext", `${time.toFixed(1)} s`);
    output.textContent = `${time.toFixed(1)} s of ${this.#end.toFixed(0)} s`;
    for (const road of this.#roads) road.show(time);
    if (tell) this.#told(time);
  }
}

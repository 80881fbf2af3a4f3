// The map with its points, which are dragged, and the frame it shows.

const LARGER = 1.3; // ratio up to which a frame is kept
const MARK = 9; // pixels of a marker; its area for pointers has at least 22
const WIDTHS = [1.5, 5]; // pixels of a path of weight 0, and how many more of weight 1
const FAINT = 0.12; // opacity of a radar whose cases have weight 0
const COLORS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00"];

/** The map: canvas with the hazard, and above it an SVG with the guide, a run and the points. */
class MapView {
  constructor(outbox, gestures) {
    [this.outbox, this.gestures] = [outbox, gestures];
    this.time = 0; // step of the run that is shown, for radars that move or switch
    this.frame = null; // corners {low, high} in units of length
    this.moved = new Map(); // positions of points that Python has not confirmed
    this.held = null; // the point that the pointer holds
    this.painted = []; // what the canvas shows
    this.canvas = make("canvas", { class: "csw-hazard", "aria-hidden": "true" });
    this.guide = make("polyline", { class: "csw-guide" });
    this.mixture = make("g", { class: "csw-mixture" });
    this.run = make("g", { class: "csw-run" });
    this.paths = make("g", { class: "csw-paths" });
    this.zones = make("g", { class: "csw-zones" });
    this.others = make("g", { class: "csw-disc" }); // further target zones
    this.target = make("circle", { class: "csw-disc" });
    this.points = make("g");
    this.svg = make(
      "svg",
      { role: "group", "aria-label": "Map: target, radars and members" },
      this.zones, this.others, this.target, this.paths, this.mixture, this.guide, this.run, this.points,
    );
    this.element = make("div", { class: "csw-map" }, this.canvas, this.svg);
    this.marks = new Map();
    new ResizeObserver(() => this.draw()).observe(this.element);
  }

  get size() {
    return this.element.clientWidth || 400;
  }

  toPixels([x, y]) {
    const { low, high } = this.frame;
    const scale = this.size / (high[0] - low[0]);
    return [(x - low[0]) * scale, (high[1] - y) * scale];
  }

  /** Position of the pointer in units of length. */
  pointer(event) {
    const { low, high } = this.frame;
    const box = this.svg.getBoundingClientRect();
    const scale = (high[0] - low[0]) / box.width;
    return [low[0] + (event.clientX - box.left) * scale, high[1] - (event.clientY - box.top) * scale];
  }

  inside(position) {
    const { low, high } = this.frame;
    return position.map((value, k) => Math.min(Math.max(value, low[k]), high[k]));
  }

  /** Show a new state; the frame stays while the pointer holds a point. */
  update(state) {
    this.state = state;
    const { scene, map } = state;
    if (this.outbox.idle && !this.held) this.moved.clear();
    if (!this.frame) this.frame = around(scene);
    if (map && !this.held && !suits(this.frame, map.frame)) this.frame = map.frame;
    this.draw();
  }

  /** Position of a point at the time that is shown. */
  position(name, scene) {
    const [kind, index] = name.split(" ");
    const start = this.moved.get(name) || (kind === "target" ? scene.target.center : scene[`${kind}s`][index]);
    const shift = this.shift(name, scene);
    return start.map((value, k) => value + shift[k]);
  }

  track(name, scene) {
    const [kind, index] = name.split(" ");
    return kind === "radar" ? scene.tracks[index] : null;
  }

  /** How far a radar has moved by the time that is shown. */
  shift(name, scene) {
    const track = this.track(name, scene);
    if (!track) return [0, 0];
    const step = Math.min(Math.floor(this.time), track.length - 1);
    const next = Math.min(step + 1, track.length - 1);
    return [0, 1].map((k) => track[step][k] + (this.time - step) * (track[next][k] - track[step][k]) - track[0][k]);
  }

  draw() {
    if (!this.state || !this.state.scene) return;
    const { scene, guide, map } = this.state;
    this.svg.setAttribute("viewBox", `0 0 ${this.size} ${this.size}`);
    const shown = map && Math.round(Math.min(this.time / scene.steps, 1) * (map.shades.length - 1));
    const shades = map && map.shades[shown];
    const painted = [map, this.frame, this.size, shades];
    if (map && painted.some((value, k) => value !== this.painted[k])) this.drawHazard(map, shades);
    this.painted = painted;
    const scale = this.size / (this.frame.high[0] - this.frame.low[0]);
    const [x, y] = this.toPixels(this.position("target 0", scene));
    place(this.target, { cx: x, cy: y, r: scene.target.radius * scale });
    this.zones.replaceChildren(...scene.zones.map((zone) => this.drawn(zone, scale)));
    this.others.replaceChildren(...scene.others.map((disc) => this.drawn(disc, scale)));
    this.guide.classList.toggle("csw-mean", scene.prior.length > 1);
    if (guide) {
      this.guide.setAttribute("points", this.line(guide.positions));
      this.guide.classList.toggle("csw-stale", !guide.current);
    }
    this.drawMixture(scene);
    const names = ["target 0"];
    scene.radars.forEach((_, k) => names.push(`radar ${k}`));
    scene.members.forEach((_, k) => names.push(`member ${k}`));
    for (const name of [...this.marks.keys()].filter((known) => !names.includes(known))) {
      this.marks.get(name).remove();
      this.marks.delete(name);
    }
    this.paths.replaceChildren();
    for (const name of names) this.drawPoint(name, scene);
  }

  line(positions) {
    return positions.map((position) => this.toPixels(position).join()).join(" ");
  }

  /** Draw the paths of a mixture, as wide as they are likely. */
  drawMixture(scene) {
    const { mixture } = this.state;
    const paths = mixture && scene.prior.length > 1 ? mixture.paths : [];
    this.mixture.replaceChildren(...paths.map((positions, k) => make(
      "polyline", { points: this.line(positions), "stroke-width": WIDTHS[0] + mixture.weights[k] * WIDTHS[1] },
    )));
    this.mixture.classList.toggle("csw-stale", Boolean(mixture) && !mixture.current);
  }

  /** Sum over the cases that have a radar of the worst prior, or until it is known of the prior. */
  weight(index, scene) {
    const { mixture } = this.state;
    const priors = mixture && mixture.worst_prior.length === scene.prior.length ? mixture.worst_prior : scene.prior;
    return scene.cases[index].reduce((sum, k) => sum + priors[k], 0);
  }

  /** Radars that move with one: those of its cloud. */
  cloud(index, scene) {
    const number = scene.clouds[index];
    const others = [...scene.clouds.keys()].filter((k) => scene.clouds[k] === number);
    return number === null ? [index] : others;
  }

  /** How dark a radar of a cloud is: the likeliest one of its cloud is as dark as others. */
  drawWeight(index, scene, mark) {
    const most = Math.max(...this.cloud(index, scene).map((k) => this.weight(k, scene)));
    mark.classList.toggle("csw-unsure", scene.clouds[index] !== null);
    const share = scene.clouds[index] === null || most === 0 ? 1 : this.weight(index, scene) / most;
    mark.querySelector("path").setAttribute("fill-opacity", FAINT + (1 - FAINT) * share);
  }

  /** The region of a zone. */
  drawn({ vertices, radius }, scale) {
    const corners = vertices.map((corner) => this.toPixels(corner));
    if (corners.length > 1) return make("polygon", { points: corners.map((corner) => corner.join()).join(" ") });
    return make("circle", { cx: corners[0][0], cy: corners[0][1], r: radius * scale });
  }

  /** Draw the path of a radar, and the radar fainter where it is not active. */
  drawTrack(name, scene, mark) {
    const track = this.track(name, scene);
    const step = track ? Math.min(Math.ceil(this.time), track.length - 1) : 0;
    mark.classList.toggle("csw-off", Boolean(track) && track[step][2] === 0);
    if (!track) return;
    const [x, y] = this.position(name, scene).map((value, k) => value - this.shift(name, scene)[k]);
    const points = track.map((at) => this.toPixels([at[0] - track[0][0] + x, at[1] - track[0][1] + y]).join());
    this.paths.append(make("polyline", { points: points.join(" ") }));
  }

  drawPoint(name, scene) {
    if (!this.marks.has(name)) {
      this.marks.set(name, this.makePoint(name));
      this.points.append(this.marks.get(name));
    }
    const mark = this.marks.get(name);
    const position = this.position(name, scene);
    const [x, y] = this.toPixels(position);
    mark.setAttribute("transform", `translate(${x} ${y})`);
    this.drawTrack(name, scene, mark);
    const [kind, index] = name.split(" ");
    const named = kind === "member" && scene.kinds.length ? `, ${scene.kinds[index]},` : "";
    mark.classList.toggle("csw-uncounted", kind === "member" && !scene.counting[index]);
    if (kind === "radar") this.drawWeight(index, scene, mark);
    const unsure = kind === "radar" && scene.clouds[index] !== null;
    const cases = unsure ? `, case ${scene.cases[index].join(", ")}, weight ${short(this.weight(index, scene))}` : "";
    const label = `${title(name)}${named} at ${position.map((value) => short(value)).join(", ")}${cases}`;
    mark.setAttribute("aria-label", `${label}; arrow keys move it`);
    mark.querySelector("title").textContent = label;
  }

  makePoint(name) {
    const [kind, index] = name.split(" ");
    const color = COLORS[index % COLORS.length];
    const shapes = {
      radar: make("path", { d: `M0 ${-MARK}L${MARK} ${MARK * 0.8}H${-MARK}Z` }),
      member: make("circle", { r: MARK * 0.6, fill: color }),
      target: make("path", { d: `M${-MARK} 0H${MARK}M0 ${-MARK}V${MARK}` }),
    };
    return make(
      "g",
      {
        class: `csw-point csw-${kind}`,
        "data-point": name,
        tabindex: "0",
        role: "button",
        "aria-roledescription": "movable point",
        pointerdown: (event) => this.grab(event, name),
        pointermove: (event) => this.drag(event, name),
        pointerup: (event) => this.release(event),
        pointercancel: (event) => this.release(event),
        keydown: (event) => this.key(event, name),
      },
      make("title"),
      make("circle", { class: "csw-reach", r: kind === "member" ? MARK * 1.3 : MARK * 2.4 }),
      shapes[kind],
    );
  }

  grab(event, name) {
    if (event.button) return;
    event.preventDefault();
    event.currentTarget.focus();
    event.currentTarget.setPointerCapture(event.pointerId);
    const at = this.pointer(event);
    const offset = this.position(name, this.state.scene).map((value, k) => value - at[k]);
    this.held = { name, gesture: this.gestures.begin(), offset };
  }

  drag(event, name) {
    if (!this.held || this.held.name !== name) return;
    const at = this.pointer(event).map((value, k) => value + this.held.offset[k]);
    this.move(name, at, this.held.gesture);
  }

  release() {
    this.held = null;
    this.outbox.flush();
  }

  key(event, name) {
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const step = steps[event.key];
    if (!step || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    const length = (this.frame.high[0] - this.frame.low[0]) / (event.shiftKey ? 500 : 50);
    const from = this.position(name, this.state.scene);
    const moved = from.map((value, k) => value + length * step[k]);
    this.move(name, moved, this.gestures.ofKey(name));
  }

  move(name, wanted, gesture) {
    const [point, index] = name.split(" ");
    const { scene } = this.state;
    const shift = this.shift(name, scene);
    const position = this.inside(wanted).map((value, k) => value - shift[k]); // at time 0
    if (point === "radar") {
      const start = scene.radars[index];
      for (const other of this.cloud(Number(index), scene)) {
        const from = scene.radars[other];
        this.moved.set(`radar ${other}`, from.map((value, k) => position[k] + (value - start[k])));
      }
    }
    this.moved.set(name, position);
    this.outbox.sendSoon({ type: "move", point, index: Number(index), position, gesture });
    this.draw();
  }

  /** Paint the rates as shades, where the frame shows them. */
  drawHazard(map, shades) {
    const bytes = Uint8Array.from(atob(shades), (letter) => letter.charCodeAt(0));
    const image = new ImageData(map.size, map.size);
    bytes.forEach((shade, k) => {
      const row = map.size - 1 - Math.floor(k / map.size); // shades begin at the bottom
      image.data.set([213, 94, 0, 0.55 * shade], 4 * (row * map.size + (k % map.size)));
    });
    const small = make("canvas", { width: map.size, height: map.size });
    small.getContext("2d").putImageData(image, 0, 0);
    const [left, bottom] = this.toPixels(map.low);
    const [right, top] = this.toPixels(map.high);
    [this.canvas.width, this.canvas.height] = [this.size, this.size];
    this.canvas.getContext("2d").drawImage(small, left, top, right - left, bottom - top);
  }

  /** Draw the members of a run at a time between its first step and its last. */
  drawRun(run, time) {
    this.run.replaceChildren();
    const moved = this.time !== time;
    this.time = time;
    const { map } = this.state || {};
    if (moved && map && map.shades.length > 1) this.draw(); // rates depend on time
    if (!run || !this.frame) return;
    const step = Math.min(Math.floor(time), run.positions.length - 1);
    const next = Math.min(step + 1, run.positions.length - 1);
    run.positions[step].forEach((from, member) => {
      const [alive, ghost] = [run.alive[step][member], run.ghosts[step][member]];
      const to = alive || ghost ? run.positions[next][member] : from;
      const at = from.map((value, k) => value + (time - step) * (to[k] - value));
      const leads = run.leaders[step] === member;
      const color = COLORS[member % COLORS.length];
      if (!alive) {
        const lost = run.positions[run.alive.findIndex((living) => !living[member])][member];
        this.mark(make("path", { d: "M-5 -5L5 5M-5 5L5 -5", class: "csw-lost" }), lost);
      }
      const shade = ghost ? { stroke: color, class: "csw-ghost" } : { fill: color, class: leads ? "csw-leader" : "" };
      if (alive || ghost) this.mark(make("circle", { r: leads ? 7 : 5, ...shade }), at);
    });
  }

  /** Draw a mark of a run at a position. */
  mark(element, position) {
    const [x, y] = this.toPixels(position);
    element.setAttribute("transform", `translate(${x} ${y})`);
    this.run.append(element);
  }
}

function place(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
}

/** Whether a frame holds another one, and is hardly larger: it is then kept. */
function suits(frame, other) {
  const holds = [0, 1].every((k) => frame.low[k] <= other.low[k] && other.high[k] <= frame.high[k]);
  return holds && frame.high[0] - frame.low[0] < LARGER * (other.high[0] - other.low[0]);
}

/** A square frame around the points of a scene, until Python has sent one. */
function around(scene) {
  const points = [...scene.members, ...scene.radars, scene.target.center];
  const ends = (k, best) => best(...points.map((point) => point[k]));
  const middle = [0, 1].map((k) => (ends(k, Math.min) + ends(k, Math.max)) / 2);
  const widths = [0, 1].map((k) => ends(k, Math.max) - ends(k, Math.min));
  const half = 0.65 * Math.max(...widths) + scene.target.radius;
  return { low: middle.map((m) => m - half), high: middle.map((m) => m + half) };
}

function title(name) {
  const [kind, index] = name.split(" ");
  return kind === "target" ? "Target" : `${kind[0].toUpperCase()}${kind.slice(1)} ${index}`;
}

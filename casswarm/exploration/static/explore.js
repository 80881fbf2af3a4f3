// View of a session of casswarm.exploration: the same module draws the widget and the local page.
// The model has `send(message)`, `on("msg:custom", listener)`, `set` and `save_changes`, as in
// anywidget, and may say in `silence` what it means that Python does not answer. Messages from
// Python hold the parts of a state that have changed (casswarm/exploration/view.py).

const SVG = "http://www.w3.org/2000/svg";
const STEPS = 200; // positions of a slider
const PLAY = 250; // milliseconds of a step of a run
const PAUSE = 800; // milliseconds between keys of one gesture
const LATE = 4000; // milliseconds after which an answer is missed
const LARGER = 1.3; // ratio up to which a frame is kept
const MARK = 9; // pixels of a marker; its area for pointers has at least 22
const STARTING = "starting …";
const SILENCE = "no answer yet: another cell may be running; if the kernel was restarted, run this cell again";
const HELP = "▲ radar, ● member, ⊕ target: drag them, or choose one with Tab and move it with the arrow keys";
const COLORS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00"];

/** An element with attributes (functions are listeners) and children. */
function make(tag, attributes = {}, ...children) {
  const vector = ["svg", "g", "circle", "path", "polyline", "text", "title"].includes(tag);
  const element = vector ? document.createElementNS(SVG, tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (value !== false && value !== null) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

/** A number for reading, with the given significant digits. */
const short = (value, digits = 3) => String(Number(Number(value).toPrecision(digits)));
const floor4 = (value) => (Math.floor(value * 1e4 + 1e-9) / 1e4).toFixed(4);
const ceil4 = (value) => (Math.ceil(value * 1e4 - 1e-9) / 1e4).toFixed(4);

/** Messages to Python: at most one move a frame, numbered, so that answers to old ones are known. */
class Outbox {
  constructor(model, miss) {
    [this.model, this.miss] = [model, miss]; // `miss` is called if an answer is late
    this.number = 0;
    this.handled = 0;
    this.waiting = null;
  }

  send(message) {
    this.flush();
    this.post(message);
  }

  post(message) {
    this.number += 1;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.idle || this.miss(), LATE);
    this.model.send({ ...message, number: this.number }); // fails if the kernel was restarted
  }

  sendSoon(message) {
    if (!this.waiting) requestAnimationFrame(() => this.flush());
    this.waiting = message;
  }

  flush() {
    const message = this.waiting;
    this.waiting = null;
    if (message) this.post(message);
  }

  get idle() {
    return !this.waiting && this.handled >= this.number;
  }
}

/** Changes that belong together: one step of the history. */
class Gestures {
  constructor() {
    this.prefix = Math.random().toString(36).slice(2);
    this.count = 0;
    this.last = "";
    this.time = 0;
  }

  begin() {
    this.last = "";
    return `${this.prefix}-${++this.count}`;
  }

  /** The gesture of a key: that of the key before, if it moved the same thing just now. */
  ofKey(thing) {
    const now = Date.now();
    if (thing !== this.last || now > this.time + PAUSE) this.count += 1;
    [this.last, this.time] = [thing, now];
    return `${this.prefix}-${this.count}`;
  }
}

/** The map: canvas with the hazard, and above it an SVG with the guide, a run and the points. */
class MapView {
  constructor(outbox, gestures) {
    [this.outbox, this.gestures] = [outbox, gestures];
    this.frame = null; // corners {low, high} in units of length
    this.moved = new Map(); // positions of points that Python has not confirmed
    this.held = null; // the point that the pointer holds
    this.painted = []; // what the canvas shows
    this.canvas = make("canvas", { class: "csw-hazard", "aria-hidden": "true" });
    this.guide = make("polyline", { class: "csw-guide" });
    this.run = make("g", { class: "csw-run" });
    this.zone = make("circle", { class: "csw-zone" });
    this.points = make("g");
    this.svg = make(
      "svg",
      { role: "group", "aria-label": "Map: target, radars and members" },
      this.zone, this.guide, this.run, this.points,
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

  position(name, scene) {
    const [kind, index] = name.split(" ");
    return this.moved.get(name) || (kind === "target" ? scene.target.center : scene[`${kind}s`][index]);
  }

  draw() {
    if (!this.state || !this.state.scene) return;
    const { scene, guide, map } = this.state;
    this.svg.setAttribute("viewBox", `0 0 ${this.size} ${this.size}`);
    const painted = [map, this.frame, this.size];
    if (map && painted.some((value, k) => value !== this.painted[k])) this.drawHazard(map);
    this.painted = painted;
    const scale = this.size / (this.frame.high[0] - this.frame.low[0]);
    const [x, y] = this.toPixels(this.position("target 0", scene));
    place(this.zone, { cx: x, cy: y, r: scene.target.radius * scale });
    if (guide) {
      this.guide.setAttribute("points", guide.positions.map((p) => this.toPixels(p).join()).join(" "));
      this.guide.classList.toggle("csw-stale", !guide.current);
    }
    const names = ["target 0"];
    scene.radars.forEach((_, k) => names.push(`radar ${k}`));
    scene.members.forEach((_, k) => names.push(`member ${k}`));
    for (const name of [...this.marks.keys()].filter((known) => !names.includes(known))) {
      this.marks.get(name).remove();
      this.marks.delete(name);
    }
    for (const name of names) this.drawPoint(name, scene);
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
    const label = `${title(name)} at ${position.map((value) => short(value)).join(", ")}`;
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
    const position = this.inside(wanted);
    this.moved.set(name, position);
    this.outbox.sendSoon({ type: "move", point, index: Number(index), position, gesture });
    this.draw();
  }

  /** Paint the rates as shades, where the frame shows them. */
  drawHazard(map) {
    const bytes = Uint8Array.from(atob(map.shades), (letter) => letter.charCodeAt(0));
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
    if (!run || !this.frame) return;
    const step = Math.min(Math.floor(time), run.positions.length - 1);
    const next = Math.min(step + 1, run.positions.length - 1);
    run.positions[step].forEach((from, member) => {
      const to = run.alive[step][member] ? run.positions[next][member] : from;
      const at = from.map((value, k) => value + (time - step) * (to[k] - value));
      const [x, y] = this.toPixels(at);
      const leads = run.leaders[step] === member;
      const color = COLORS[member % COLORS.length];
      const mark = run.alive[step][member]
        ? make("circle", { r: leads ? 7 : 5, fill: color, class: leads ? "csw-leader" : "" })
        : make("path", { d: "M-5 -5L5 5M-5 5L5 -5", class: "csw-lost" });
      mark.setAttribute("transform", `translate(${x} ${y})`);
      this.run.append(mark);
    });
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

/** Sliders and lists of the scenario's parameters, and the list of policies. */
class Controls {
  constructor(outbox, gestures) {
    [this.outbox, this.gestures] = [outbox, gestures];
    this.element = make("div", { class: "csw-controls" });
    this.rows = new Map();
    this.busy = null; // key of the slider that is being moved
  }

  update(scene) {
    const policies = Object.entries(scene.policies).map(([name, text]) => ({ name, text }));
    this.list("policy", scene.policy, policies, (name) => ({ type: "policy", name }));
    for (const { key, values, value } of scene.choices) {
      const options = values.map((name) => ({ name, text: "" }));
      this.list(key, value, options, (name) => ({ type: "change", key, value: name }));
    }
    for (const parameter of scene.parameters) this.slider(parameter);
  }

  list(key, value, options, message) {
    if (!this.rows.has(key)) {
      const items = options.map(({ name, text }) => make("option", { value: name, title: text }, name));
      const select = make(
        "select",
        { name: key, change: () => this.outbox.send(message(select.value)) },
        ...items,
      );
      this.rows.set(key, select);
      this.element.append(make("label", { class: "csw-row" }, make("span", {}, key), select));
    }
    const select = this.rows.get(key);
    if (![...select.options].some((option) => option.value === value)) {
      select.append(make("option", { value }, value));
    }
    select.value = value;
    select.title = (options.find(({ name }) => name === value) || {}).text || "";
  }

  slider(parameter) {
    const { key, low, high, whole, description } = parameter;
    if (!this.rows.has(key)) {
      const range = make("input", {
        type: "range", min: whole ? low : 0, max: whole ? high : STEPS, name: key, title: description,
        "aria-label": key,
      });
      const number = make("input", { type: "number", step: "any", "aria-label": `${key}, exact value` });
      const send = (value) => {
        this.outbox.sendSoon({ type: "change", key, value, gesture: this.gesture });
      };
      range.addEventListener("input", () => {
        if (this.busy !== key) this.gesture = this.gestures.begin();
        this.busy = key;
        const t = Number(range.value);
        const value = whole ? t : Number(short(low * (high / low) ** (t / STEPS)));
        number.value = value;
        send(value);
      });
      range.addEventListener("change", () => { this.busy = null; this.outbox.flush(); });
      number.addEventListener("change", () => {
        this.gesture = this.gestures.begin();
        if (number.value !== "") send(Number(number.value));
      });
      this.rows.set(key, { range, number });
      const row = make("div", { class: "csw-row", title: description });
      row.append(make("span", {}, key), range, number);
      this.element.append(row);
    }
    if (this.busy === key) return;
    const { range, number } = this.rows.get(key);
    const value = parameter.value;
    number.value = short(value, 6);
    range.value = whole ? value : (STEPS * Math.log(value / low)) / Math.log(high / low);
    range.setAttribute("aria-valuetext", short(value));
  }
}

/** Plays a saved run on the map. */
class Player {
  constructor(map) {
    this.map = map;
    [this.runs, this.time, this.playing] = [[], 0, false];
    this.button = make("button", { type: "button", click: () => this.toggle() }, "Play");
    this.range = make("input", {
      type: "range", min: 0, value: 0, step: "any", "aria-label": "step of the run",
      input: () => { this.stop(); this.show(Number(this.range.value)); },
    });
    this.choice = make("select", { "aria-label": "run", change: () => this.show(this.time) });
    this.note = make("output", {});
    const controls = make("div", { class: "csw-row" }, this.button, this.range, this.choice);
    this.element = make("div", { class: "csw-player" }, controls, this.note);
  }

  update(runs) {
    this.runs = runs;
    const chosen = this.choice.value || "0";
    this.choice.replaceChildren(...runs.map((_, k) => make("option", { value: k }, `run ${k}`)));
    if (Number(chosen) < runs.length) this.choice.value = chosen;
    this.show(this.time);
  }

  get run() {
    return this.runs[Number(this.choice.value)];
  }

  show(time) {
    const last = this.run ? this.run.positions.length - 1 : 0;
    this.time = Math.min(time, last);
    [this.range.max, this.range.value] = [last, this.time];
    this.button.disabled = !this.run;
    const alive = this.run ? this.run.alive[Math.floor(this.time)].filter(Boolean).length : 0;
    this.note.textContent = this.run ? `step ${Math.floor(this.time)} of ${last}, ${alive} alive` : "";
    this.map.drawRun(this.time > 0 ? this.run : null, this.time);
  }

  toggle() {
    if (this.playing) return this.stop();
    if (this.run && this.time >= this.run.positions.length - 1) this.time = 0;
    [this.playing, this.before] = [true, performance.now()];
    this.button.textContent = "Pause";
    return requestAnimationFrame((now) => this.tick(now));
  }

  stop() {
    this.playing = false;
    this.button.textContent = "Play";
  }

  tick(now) {
    if (!this.playing || !this.run) return this.stop();
    this.show(this.time + Math.max(0, now - this.before) / PLAY);
    this.before = now;
    if (this.time >= this.run.positions.length - 1) return this.stop();
    return requestAnimationFrame((next) => this.tick(next));
  }
}

/** The numbers: survival of the guide, and success of the policy. */
class Results {
  constructor() {
    this.survival = make("output", { class: "csw-survival" }, "…");
    this.success = make("output", { class: "csw-success" }, "…");
    this.detail = make("div", { class: "csw-detail" });
    this.bar = make("div", { class: "csw-interval" });
    this.element = make(
      "div",
      { class: "csw-results" },
      make("div", {}, "guide's survival ", this.survival),
      make("div", {}, "success ", this.success),
      make("div", { class: "csw-track", "aria-hidden": "true" }, this.bar),
      this.detail,
    );
  }

  update({ guide, success, busy }) {
    if (guide) {
      const bound = guide.bound === null ? "" : ` (no guide exceeds ${ceil4(guide.bound)})`;
      this.survival.textContent = `${guide.survival.toFixed(4)}${bound}`;
      this.survival.classList.toggle("csw-stale", !guide.current);
    }
    this.success.classList.toggle("csw-stale", !success || !success.current);
    if (!success) return;
    const { low, high, proven, runs, policy } = success;
    const more = busy ? "; computing …" : "";
    this.success.textContent = `${floor4(low)} to ${ceil4(high)}`;
    this.detail.textContent = `${policy}, ${proven ? "proven bounds" : `95 % interval of ${runs} runs`}${more}`;
    this.bar.style.left = `${100 * low}%`;
    this.bar.style.width = `${Math.max(0.5, 100 * (high - low))}%`;
  }
}

/** Text of the scenario, to be copied also where a page may not write to the clipboard. */
function showText(box, text, notify) {
  const area = make("textarea", { readonly: "", rows: 12, "aria-label": "scenario as TOML" });
  area.value = text;
  const close = make("button", { type: "button", click: () => box.replaceChildren() }, "Close");
  box.replaceChildren(area, close);
  area.select();
  if (!navigator.clipboard) return notify("select and copy the text");
  return navigator.clipboard.writeText(text).then(
    () => notify("copied"),
    () => notify("the browser refuses to copy: copy the selected text"),
  );
}

/** Whether a key is for the widget alone: a notebook may delete its cell when D is typed twice. */
function isPlain(event) {
  const runsCell = event.shiftKey && event.key === "Enter";
  return !(event.ctrlKey || event.metaKey || event.altKey || runsCell || event.key === "Escape");
}

function render({ model, el }) {
  const silence = model.silence || SILENCE;
  const [outbox, gestures, state] = [new Outbox(model, () => notify(silence)), new Gestures(), {}];
  const map = new MapView(outbox, gestures);
  const [controls, player, results] = [new Controls(outbox, gestures), new Player(map), new Results()];
  const button = (label, type, key) =>
    make("button", { type: "button", title: key || label, click: () => outbox.send({ type }) }, label);
  const buttons = {
    undo: button("Undo", "undo", "Ctrl+Z"), redo: button("Redo", "redo", "Ctrl+Shift+Z"),
    reset: button("Reset", "reset"), copy: button("Copy as TOML", "copy"), save: button("Save", "save"),
  };
  const name = make("strong", {});
  const problem = make("p", { class: "csw-problem", role: "alert", hidden: "" });
  const notice = make("p", { class: "csw-notice", role: "status" });
  const text = make("div", { class: "csw-text" });
  const notify = (message) => { notice.textContent = message; };
  const bar = make("div", { class: "csw-bar" }, name, ...Object.values(buttons));
  const parameters = make("details", { open: "" }, make("summary", {}, "Parameters"), controls.element);
  const panel = make("div", { class: "csw-panel" }, results.element, player.element, parameters);
  const help = make("p", { class: "csw-help" }, HELP);
  const left = make("div", {}, map.element, help, problem, notice, text);
  const root = make(
    "div", { class: "csw", "data-busy": "true" }, bar, make("div", { class: "csw-main" }, left, panel),
  );
  parameters.open = el.clientWidth === 0 || el.clientWidth > 640;
  root.addEventListener("keydown", (event) => {
    const undoes = event.key.toLowerCase() === "z" && (event.ctrlKey || event.metaKey);
    if (undoes || isPlain(event)) event.stopPropagation();
    if (!undoes || event.target.type === "number") return;
    event.preventDefault();
    outbox.send({ type: event.shiftKey ? "redo" : "undo" });
  });

  let timer = 0;
  const settle = () => { // tells the notebook of a new state: marimo runs the cells that use it
    clearTimeout(timer);
    timer = setTimeout(() => {
      if (map.held || controls.busy || !outbox.idle) return settle();
      model.set("revision", state.scene.revision);
      return model.save_changes();
    }, PAUSE);
  };

  const receive = (message) => {
    if ("handled" in message) {
      outbox.handled = message.handled;
      if (outbox.idle && notice.textContent === silence) notify("");
    }
    if ("notice" in message) notify(message.notice);
    if ("toml" in message) showText(text, message.toml, notify);
    const { handled, notice: _, toml, ...parts } = message;
    Object.assign(state, parts);
    if (!state.scene) return;
    map.update(state);
    if (parts.scene) {
      name.textContent = state.scene.name;
      controls.update(state.scene);
      buttons.undo.disabled = !state.scene.can_undo;
      buttons.redo.disabled = !state.scene.can_redo;
      settle();
    }
    if (parts.guide || "success" in parts || "busy" in parts) results.update(state);
    if (parts.guide && notice.textContent === STARTING) notify("");
    if (parts.runs) player.update(parts.runs);
    else if (parts.map) player.show(player.time);
    if ("problem" in parts) {
      problem.textContent = parts.problem;
      problem.hidden = !parts.problem;
    }
    if ("busy" in parts) root.dataset.busy = parts.busy;
  };
  model.on("msg:custom", receive);
  el.append(root);
  notify(STARTING);
  outbox.send({ type: "open" });
  return () => {
    player.stop();
    clearTimeout(timer);
    clearTimeout(outbox.timer);
    model.off("msg:custom", receive);
    model.send({ type: "close" });
  };
}

export default { render };

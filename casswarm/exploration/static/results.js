// The numbers, and runs that are played on the map.

const PLAY = 250; // milliseconds of a step of a run

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
    const last = this.run ? this.run.positions.length - 1 : Math.ceil(time); // until there are runs
    this.time = Math.min(time, last);
    [this.range.max, this.range.value] = [last, this.time];
    this.button.disabled = !this.run;
    this.note.textContent = this.run ? this.caption(Math.floor(this.time), last) : "";
    this.map.drawRun(this.time > 0 ? this.run : null, this.time);
  }

  caption(step, last) {
    const [alive, ghosts] = [this.run.alive, this.run.ghosts].map((masks) => masks[step].filter(Boolean).length);
    const unknown = ghosts ? `, ${ghosts} ghost${ghosts > 1 ? "s" : ""}` : "";
    return `step ${step} of ${last}, ${alive} alive${unknown}`;
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
    this.measure = make("span", {}, "guide's survival ");
    this.survival = make("output", { class: "csw-survival" }, "…");
    this.mixture = make("div", { class: "csw-mixed" });
    this.cases = make("table", {});
    this.success = make("output", { class: "csw-success" }, "…");
    this.detail = make("div", { class: "csw-detail" });
    this.bar = make("div", { class: "csw-interval" });
    this.element = make(
      "div",
      { class: "csw-results" },
      make("div", {}, this.measure, this.survival),
      this.mixture,
      make("div", {}, "success ", this.success),
      make("div", { class: "csw-track", "aria-hidden": "true" }, this.bar),
      this.detail,
      make("div", { class: "csw-cases" }, this.cases),
    );
  }

  update({ scene, guide, mixture, success, busy }) {
    if (scene.prior.length > 1) this.updateMixture(scene, mixture, success);
    else if (guide) {
      this.measure.textContent = "guide's survival ";
      [this.mixture, this.cases].forEach((element) => element.replaceChildren()); // of cases that are equal now
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

  /** What a mixture of guides is worth, and the table of the cases. */
  updateMixture(scene, last, success) {
    const mixture = last && last.worst_prior.length === scene.prior.length ? last : null; // cases may become equal
    const known = success && success.by_case.length === scene.prior.length && success.current ? success.by_case : [];
    const values = (k) => [
      k, scene.prior[k].toFixed(3),
      mixture ? mixture.worst_prior[k].toFixed(3) : "", mixture ? floor4(mixture.survivals[k]) : "",
      known.length ? `${floor4(known[k][0])} to ${ceil4(known[k][1])}` : "",
    ];
    const row = (tag, texts) => make("tr", {}, ...texts.map((text) => make(tag, {}, String(text))));
    const names = ["case", "prior", "worst prior", "survival", "success"];
    this.cases.replaceChildren(row("th", names), ...scene.prior.map((_, k) => row("td", values(k))));
    if (!mixture) return;
    const { low, high, pure, ambiguity, weights, note, current } = mixture;
    const bound = high < 1 ? ` (no mixture exceeds ${ceil4(high)})` : "";
    this.measure.textContent = `mixture's survival, ${ambiguity}: `;
    this.survival.textContent = `${floor4(low)}${bound}`;
    this.survival.title = note;
    this.survival.classList.toggle("csw-stale", !current);
    const paths = weights.length === 1 ? "1 path" : `${weights.length} paths`;
    this.mixture.textContent =
      `${paths}; best single path ${floor4(pure)}, with the case known ${floor4(mixture.known)}`;
  }
}

// View of a session of casswarm.exploration: the same module draws the widget and the local page.
// The model has `send(message)`, `on("msg:custom", listener)`, `set` and `save_changes`, as in
// anywidget, and may say in `silence` what it means that Python does not answer. Messages from
// Python hold the parts of a state that have changed (casswarm/exploration/view.py).

const STARTING = "starting …";
const SILENCE = "no answer yet: another cell may be running; if the kernel was restarted, run this cell again";
const HELP = "▲ radar, ● member, ⊕ target: drag them, or choose one with Tab and move it with the arrow keys";
const HELP_CASES =
  ". Dashed radars are in some cases only: they are as dark as the worst prior makes them, and move together. " +
  "Wide lines are the paths of the mixture; the thin line is the guide for the mean rates, which members follow";

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
      help.textContent = HELP + (state.scene.prior.length > 1 ? HELP_CASES : "");
      controls.update(state.scene);
      buttons.undo.disabled = !state.scene.can_undo;
      buttons.redo.disabled = !state.scene.can_redo;
      settle();
    }
    if (["scene", "guide", "mixture", "success", "busy"].some((name) => name in parts)) results.update(state);
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

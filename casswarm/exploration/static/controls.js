// Sliders, lists and the scenario as text.

const STEPS = 200; // positions of a slider

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
    const { key, low, high, step, description } = parameter; // without a step, the scale is logarithmic
    if (!this.rows.has(key)) {
      const range = make("input", {
        type: "range", min: step ? low : 0, max: step ? high : STEPS, step: step || 1, name: key,
        title: description, "aria-label": key,
      });
      const number = make("input", { type: "number", step: "any", "aria-label": `${key}, exact value` });
      const send = (value) => {
        this.outbox.sendSoon({ type: "change", key, value, gesture: this.gesture });
      };
      range.addEventListener("input", () => {
        if (this.busy !== key) this.gesture = this.gestures.begin();
        this.busy = key;
        const t = Number(range.value);
        const value = step ? t : Number(short(low * (high / low) ** (t / STEPS)));
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
    range.value = step ? value : (STEPS * Math.log(value / low)) / Math.log(high / low);
    range.setAttribute("aria-valuetext", short(value));
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

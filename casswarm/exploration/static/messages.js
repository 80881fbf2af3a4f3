// What is sent to Python: messages with numbers, and gestures that are one change each.

const LATE = 4000; // milliseconds after which an answer is missed
const PAUSE = 800; // milliseconds between keys of one gesture

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

// The controls of one pair of pictures.

const MOST_LISTED = 200;
const MOST_MARKED = 20000; // more than that take long to draw
const NUMBERS_FROM = 52; // CSS pixels a pixel must measure before numbers are written into it
const CLOSEST = 128; // CSS pixels a pixel measures at most
const VERDICTS = ["equal", "explained", "unexplained"];
const VIEWS = ["a", "split", "b", "error", "verdict"];
const HANDLE = 14; // CSS pixels beside the dividing line where it can be taken

class Viewer {
  constructor(element, pair) {
    this.element = element;
    this.pair = pair;
    this.view = "split"; this.exposure = 0; this.unit = "absolute"; this.divide = 0.5;
    this.chosen = null; this.hovered = null; this.pointers = new Map();
    this.marked = pair.status ? pair.listed(MOST_MARKED) : [];
    this.drawn = pair.drawn();
    this.listed = pair.status ? this.marked.slice(0, MOST_LISTED) : pair.listed(20);
    element.append(document.getElementById("viewer").content.cloneNode(true));
    this.find = (selector) => element.querySelector(selector);
    this.canvas = this.find("canvas.view");
    if (!pair.status) for (const node of element.querySelectorAll(".if-judged")) node.hidden = true;
    this.setUp();
    this.list();
    new ResizeObserver(() => this.resize()).observe(this.find(".canvas"));
    this.resize();
    // At first the worst pixel; if all are equal, one whose rays are drawn: at once, if there is no other viewer.
    const first = this.listed[0] ?? this.drawn[this.drawn.length >> 1];
    tell(this, first ?? 0);
    const alone = document.querySelectorAll(".viewer").length === 1;
    if (first !== undefined && pair.status && (this.listed.length || alone)) this.choose(first, false);
  }

  // ---------------------------------------------------------------------------------------------- controls
  setUp() {
    const group = `view-${[...document.querySelectorAll(".viewer")].indexOf(this.element)}`;
    for (const radio of this.element.querySelectorAll(".views input")) {
      radio.name = group;
      radio.checked = radio.value === this.view;
      radio.addEventListener("change", () => this.show(radio.value));
    }
    const on = (selector, type, act) => this.find(selector).addEventListener(type, act);
    on(".divide", "input", (event) => { this.divide = Number(event.target.value); this.draw(); });
    on(".exposure", "input", (event) => this.expose(Number(event.target.value)));
    on(".unit", "change", (event) => { this.unit = event.target.value; this.images = {}; this.draw(); });
    on(".mark", "change", () => this.draw());
    on(".in", "click", () => this.zoom(2));
    on(".out", "click", () => this.zoom(0.5));
    on(".fit", "click", () => this.fit());
    const canvas = this.canvas;
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.release(event, true));
    canvas.addEventListener("pointercancel", (event) => this.release(event, false));
    canvas.addEventListener("pointerleave", () => { this.hovered = null; this.refresh(); });
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { this.images = {}; this.draw(); });
    this.find(".names").textContent = `A: ${this.pair.names[0]}. B: ${this.pair.names[1]}.` + (this.pair.step > 1
      ? ` Of ${this.pair.of.join(" x ")} pixels, the worst of each ${this.pair.step} x ${this.pair.step} is shown.` : "");
  }

  show(view) {
    if (view === "verdict" && !this.pair.status) return;
    this.view = view;
    for (const radio of this.element.querySelectorAll(".views input")) radio.checked = radio.value === view;
    this.draw();
  }

  expose(stops) {
    this.exposure = Math.min(Math.max(stops, -12), 12);
    this.find(".exposure").value = this.exposure;
    this.find(".stops").textContent = (this.exposure > 0 ? "+" : "") + String(this.exposure).replace("-", "−");
    this.images = {};
    this.draw();
  }

  key(event) {
    const step = event.shiftKey ? 10 : 1;
    const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] };
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.key in moves) this.walk(...moves[event.key]);
    else if (event.key === "+" || event.key === "=") this.zoom(2);
    else if (event.key === "-") this.zoom(0.5);
    else if (event.key === "0") this.fit();
    else if (event.key === "n" || event.key === "p") this.next(event.key === "n" ? 1 : -1);
    else if (event.key === "[" || event.key === "]") this.expose(this.exposure + (event.key === "]" ? 0.5 : -0.5));
    else if (event.key === "Escape") this.choose(null);
    else if ("12345".includes(event.key)) this.show(VIEWS[Number(event.key) - 1]);
    else return;
    event.preventDefault();
  }

  walk(dx, dy) {
    const { width, height } = this.pair;
    const from = this.chosen ?? this.told;
    const x = Math.min(Math.max((from % width) + dx, 0), width - 1);
    const y = Math.min(Math.max(Math.floor(from / width) + dy, 0), height - 1);
    this.choose(y * width + x);
  }

  next(step) {
    if (!this.listed.length) return;
    const at = this.listed.indexOf(this.chosen);
    const count = this.listed.length;
    this.choose(this.listed[at < 0 ? (step > 0 ? 0 : count - 1) : (at + step + count) % count]);
  }

  /** List the pixels to look at first. */
  list() {
    const count = this.listed.length;
    const unequal = this.pair.status ? this.pair.status.reduce((sum, status) => sum + (status > 0), 0) : count;
    this.find(".unequal").hidden = count === 0;
    this.find(".unequal .heading").textContent = !this.pair.status ? "Pixels that differ most"
      : unequal > count ? `The first ${count} of ${unequal} unequal pixels, the worst first` : "Unequal pixels, the worst first";
    for (const i of this.listed) this.find(".unequal ol").append(this.button(i));
    const drawn = this.drawn.filter((i) => !this.listed.includes(i));
    this.find(".drawn").hidden = drawn.length === 0;
    for (const i of drawn) this.find(".drawn ol").append(this.button(i));
  }

  /** Make a button that chooses a pixel, in a list. */
  button(i) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = this.pair.place(i).join(", ");
    if (this.pair.status) button.className = VERDICTS[this.pair.status[i]];
    button.addEventListener("click", () => this.choose(i));
    const item = document.createElement("li");
    item.append(button);
    return item;
  }

  // ------------------------------------------------------------------------------------ pointers and zoom
  resize() {
    const { width, height } = this.pair;
    const room = this.find(".canvas").clientWidth;
    const most = Math.max(240, 0.82 * innerHeight);
    const wide = Math.min(room, (most * width) / height);
    if (!room || (wide === this.wide && this.ratio === devicePixelRatio)) return;
    const fitted = this.scale === undefined || this.scale <= this.least;
    [this.wide, this.tall, this.ratio] = [wide, (wide * height) / width, devicePixelRatio];
    this.least = wide / width;
    this.canvas.style.width = `${this.wide}px`;
    this.canvas.style.height = `${this.tall}px`;
    this.canvas.width = Math.round(this.wide * this.ratio);
    this.canvas.height = Math.round(this.tall * this.ratio);
    if (fitted) this.fit();
    else this.zoom(1);
  }

  fit() {
    [this.scale, this.left, this.top] = [this.least, 0, 0];
    this.draw();
  }

  /** Zoom about a place on the canvas: by default the chosen pixel, or the middle. */
  zoom(factor, at) {
    const { width, height } = this.pair;
    if (!at) {
      const i = this.chosen;
      at = i === null ? [this.wide / 2, this.tall / 2]
        : [(i % width + 0.5 - this.left) * this.scale, (Math.floor(i / width) + 0.5 - this.top) * this.scale];
    }
    const scale = Math.min(Math.max(factor * this.scale, this.least), Math.max(CLOSEST, this.least));
    const [x, y] = [this.left + at[0] / this.scale, this.top + at[1] / this.scale];
    this.scale = scale;
    this.pan(x - at[0] / scale, y - at[1] / scale);
    if (this.chosen !== null && factor !== 1) this.reveal(this.chosen);
  }

  pan(left, top) {
    const { width, height } = this.pair;
    this.left = Math.min(Math.max(left, 0), width - this.wide / this.scale);
    this.top = Math.min(Math.max(top, 0), height - this.tall / this.scale);
    this.draw();
  }

  /** Move a pixel into sight. */
  reveal(i) {
    const { width } = this.pair;
    const [x, y] = [i % width, Math.floor(i / width)];
    const [across, down] = [this.wide / this.scale, this.tall / this.scale];
    const out = x < this.left || x + 1 > this.left + across || y < this.top || y + 1 > this.top + down;
    if (out) this.pan(x + 0.5 - across / 2, y + 0.5 - down / 2);
  }

  spot(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  pixelAt([x, y]) {
    const { width, height } = this.pair;
    const [px, py] = [Math.floor(this.left + x / this.scale), Math.floor(this.top + y / this.scale)];
    return px >= 0 && py >= 0 && px < width && py < height ? py * width + px : null;
  }

  press(event) {
    const at = this.spot(event);
    this.pointers.set(event.pointerId, at);
    this.canvas.setPointerCapture(event.pointerId);
    const near = this.view === "split" && Math.abs(at[0] - this.divide * this.wide) < HANDLE;
    const aside = this.view === "split" && event.pointerType === "touch" && this.scale <= this.least;
    this.gesture = { from: at, moved: this.pointers.size > 1, divides: near || aside };
  }

  move(event) {
    const at = this.spot(event);
    const before = this.pointers.get(event.pointerId);
    if (!before) {
      this.hovered = this.pixelAt(at);
      this.canvas.style.cursor = this.view === "split" && Math.abs(at[0] - this.divide * this.wide) < HANDLE
        ? "col-resize" : "crosshair";
      this.refresh();
      return;
    }
    if (this.pointers.size === 2) { // pinch
      const [other] = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      this.zoom(apart(at) / Math.max(1, apart(before)), [(at[0] + other[0]) / 2, (at[1] + other[1]) / 2]);
    } else if (this.gesture.moved || Math.hypot(at[0] - this.gesture.from[0], at[1] - this.gesture.from[1]) > 4) {
      this.gesture.moved = true;
      if (this.gesture.divides) {
        this.divide = Math.min(Math.max(at[0] / this.wide, 0), 1);
        this.find(".divide").value = this.divide;
        this.draw();
      } else {
        this.pan(this.left - (at[0] - before[0]) / this.scale, this.top - (at[1] - before[1]) / this.scale);
      }
    }
    this.pointers.set(event.pointerId, at);
  }

  release(event, chooses) {
    const pressed = this.pointers.delete(event.pointerId);
    if (pressed && chooses && !this.gesture.moved) this.choose(this.pixelAt(this.spot(event)), false);
  }

  wheel(event) {
    if (!event.ctrlKey && document.activeElement !== this.canvas) return;
    event.preventDefault();
    this.zoom(2 ** (-event.deltaY / 240), this.spot(event));
  }

  // ------------------------------------------------------------------------------------------- what is seen
  choose(i, reveal = true) {
    this.chosen = i;
    this.hovered = null;
    if (i !== null && reveal) this.reveal(i);
    this.draw();
    explain(this, i);
  }

  refresh() {
    const i = this.hovered ?? this.chosen;
    if (i !== null && i !== this.told) tell(this, i);
  }

  side(x) {
    if (this.view !== "split") return this.view;
    return (x + 0.5 - this.left) * this.scale < this.divide * this.wide ? "a" : "b";
  }

  colour(view) {
    if (view === "error") return makers.error(this.pair, this.unit);
    return view === "verdict" ? makers.verdict(this.pair) : makers.light(this.pair[view], this.exposure);
  }

  colourAt(i, x) {
    const side = this.side(x);
    this.makers[side] ??= this.colour(side);
    return this.makers[side](i);
  }

  linesOf(i, x) {
    const side = this.side(x);
    if (side === "error") return [brief((this.unit === "ulp" ? this.pair.worstUlps : this.pair.worst)[i])];
    if (side === "verdict") return [VERDICTS[this.pair.status[i]]];
    return this.pair[side].map((plane) => brief(plane[i]));
  }

  image(view) {
    this.images ??= {};
    return (this.images[view] ??= painted(this.pair.width, this.pair.height, this.colour(view)));
  }

  draw() {
    if (!this.wide || this.scale === undefined) return;
    const { canvas, view } = this;
    const context = canvas.getContext("2d");
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.imageSmoothingEnabled = this.scale * this.ratio < 1;
    const paint = (name, from, to) => {
      context.save();
      context.beginPath();
      context.rect(from, 0, to - from, this.tall);
      context.clip();
      context.drawImage(this.image(name), -this.left * this.scale, -this.top * this.scale,
        this.pair.width * this.scale, this.pair.height * this.scale);
      context.restore();
    };
    const line = this.divide * this.wide;
    if (view === "split") {
      paint("a", 0, line);
      paint("b", line, this.wide);
    } else {
      paint(view, 0, this.wide);
    }
    this.makers = {};
    if (this.scale >= NUMBERS_FROM) writeNumbers(context, this);
    if (this.pair.status && view !== "verdict" && this.find(".mark").checked) markUnequal(context, this);
    if (view === "split") drawLine(context, this, line);
    if (this.chosen !== null) outline(context, this, this.chosen);
    canvas.style.touchAction = this.scale > this.least ? "none" : "pan-y";
    this.find(".for-split").hidden = view !== "split";
    this.find(".for-light").hidden = view === "error" || view === "verdict";
    this.find(".for-error").hidden = view !== "error";
    this.find(".scale").hidden = view !== "error";
    if (view === "error") drawScale(this);
    this.refresh();
  }
}

(async () => {
  for (const element of document.querySelectorAll(".viewer")) {
    const data = JSON.parse(element.querySelector("script").textContent);
    element.viewer = new Viewer(element, await Pair.from(data));
  }
  document.documentElement.dataset.ready = "yes";
})();

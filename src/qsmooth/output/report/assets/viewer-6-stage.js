// Two panes with one camera: what of the plane is seen, how it is moved, what is marked.

const MAX_ZOOM = 1e6;
const FLIGHT = 450; // milliseconds

function themeNow() {
  const isPrint = matchMedia("print").matches;
  const isDark = matchMedia("(prefers-color-scheme: dark)").matches && !isPrint;
  return isDark
    ? { ink: "#f2f2f2", halo: "#101418", paper: [22, 27, 33], away: [58, 64, 72] }
    : { ink: "#111111", halo: "#ffffff", paper: [255, 255, 255], away: [226, 226, 226] };
}

// The middle of both panes, and device pixels per unit.
class Camera {
  constructor() {
    Object.assign(this, { u: 0, v: 0, scale: 1, whole: { u: 0, v: 0, scale: 1 } });
  }

  toScreen(rect, u, v) {
    return [
      rect.x + rect.width / 2 + (u - this.u) * this.scale,
      rect.y + rect.height / 2 - (v - this.v) * this.scale,
    ];
  }

  toPlane(rect, x, y) {
    return [
      this.u + (x - rect.x - rect.width / 2) / this.scale,
      this.v - (y - rect.y - rect.height / 2) / this.scale,
    ];
  }

  get zoom() {
    return this.scale / this.whole.scale;
  }

  set zoom(zoom) {
    this.scale = this.whole.scale * Math.min(Math.max(zoom, 0.2), MAX_ZOOM);
  }
}

class Stage {
  constructor(report, view) {
    this.report = report;
    this.view = view; // what is shown: left, right, look, layout, selected
    this.element = document.getElementById("stage");
    this.canvas = document.getElementById("cells");
    this.marks = document.getElementById("marks");
    this.divide = document.getElementById("divide");
    this.camera = new Camera();
    this.hovered = null;
    this.indexes = new Map();
    this.painter = this.makePainter();
    this.pointers = new Map();
    new ResizeObserver(() => this.resize()).observe(this.element);
    this.divide.addEventListener("input", () => this.arrange());
    this.listen();
  }

  makePainter() {
    try {
      return new GlPainter(this.canvas, this.report);
    } catch {
      const fresh = this.canvas.cloneNode(); // a canvas keeps the kind of its first context
      this.canvas.replaceWith(fresh);
      this.canvas = fresh;
      this.isFlat = true;
      return new FlatPainter(fresh, this.report);
    }
  }

  index(state) {
    if (!this.indexes.has(state)) {
      const order = this.indexes.size ? this.indexes.values().next().value.order : null;
      const made = new CellIndex(state.uv, this.report.corners, state.shape.extent, order);
      this.indexes.set(state, made);
    }
    return this.indexes.get(state);
  }

  // ------------------------------------------------------------------------- size and panes

  resize() {
    const ratio = window.devicePixelRatio || 1;
    const width = Math.max(1, Math.round(this.element.clientWidth * ratio));
    const height = Math.max(1, Math.round(this.element.clientHeight * ratio));
    const isSame = this.canvas.width === width && this.canvas.height === height;
    if (isSame || matchMedia("print").matches) return;
    for (const canvas of [this.canvas, this.marks]) Object.assign(canvas, { width, height });
    this.ratio = ratio;
    this.arrange();
  }

  arrange() {
    if (!this.view.left || !this.ratio) return;
    const { width, height } = this.canvas;
    const swipes = this.view.layout === "swipe";
    this.divide.hidden = !swipes;
    const middle = swipes ? Math.round((width * this.divide.value) / 100) : Math.floor(width / 2);
    const gap = swipes ? 0 : Math.round(3 * this.ratio);
    const clips = [
      { x: 0, y: 0, width: Math.max(0, middle - gap), height },
      { x: middle + gap, y: 0, width: Math.max(0, width - middle - gap), height },
    ];
    const whole = { x: 0, y: 0, width, height };
    this.panes = ["left", "right"].map((side, k) => ({
      side, clip: clips[k], rect: swipes ? whole : clips[k], ...this.view[side],
      index: () => this.index(this.view[side].state),
    }));
    this.fit();
    this.ask();
  }

  fit() {
    const { zoom } = this.camera;
    const [a, b] = this.panes.map((pane) => pane.state.shape.extent);
    const box = [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.max(a[2], b[2]), Math.max(a[3], b[3])];
    const { width, height } = this.panes[0].rect;
    const size = [box[2] - box[0] || 1e-9, box[3] - box[1] || 1e-9];
    const scale = 0.94 * Math.min(width / size[0], height / size[1]);
    const isFirst = !this.isFitted;
    this.camera.whole = { u: (box[0] + box[2]) / 2, v: (box[1] + box[3]) / 2, scale };
    this.isFitted = true;
    if (isFirst) this.home();
    else this.camera.zoom = zoom;
  }

  home() {
    this.stay();
    Object.assign(this.camera, { u: this.camera.whole.u, v: this.camera.whole.v, zoom: 1 });
    this.moved();
  }

  moved() {
    this.ask(DRAW.moved);
    this.element.dispatchEvent(new Event("moved"));
  }

  // ------------------------------------------------------------------------------- drawing

  drawMarks(theme) {
    const context = this.marks.getContext("2d");
    context.clearRect(0, 0, this.marks.width, this.marks.height);
    for (const pane of this.panes) {
      context.save();
      context.beginPath();
      context.rect(pane.clip.x, pane.clip.y, pane.clip.width, pane.clip.height);
      context.clip();
      if (this.showsStill) this.drawStill(context, pane, theme);
      this.drawWorst(context, pane, theme);
      if (this.hovered !== null) this.outline(context, pane, this.hovered, theme, 2);
      if (this.view.selected !== null) this.outline(context, pane, this.view.selected, theme, 3);
      this.drawTitle(context, pane, theme);
      context.restore();
    }
    context.fillStyle = theme.ink;
    const edge = this.panes[1].clip.x;
    context.fillRect(edge - 2 * this.ratio, 0, this.ratio, this.marks.height);
  }

  drawTitle(context, pane, theme) {
    const text = pane.state.label;
    context.font = `600 ${14 * this.ratio}px system-ui, sans-serif`;
    const x = pane.clip.x + 8 * this.ratio, y = 20 * this.ratio;
    this.haloed(context, theme, text, x, y);
  }

  haloed(context, theme, text, x, y) {
    context.lineJoin = "round";
    context.lineWidth = 4 * this.ratio;
    context.strokeStyle = theme.halo;
    context.strokeText(text, x, y);
    context.fillStyle = theme.ink;
    context.fillText(text, x, y);
  }

  drawWorst(context, pane, theme) {
    context.font = `${11 * this.ratio}px system-ui, sans-serif`;
    for (const { cell, rank } of pane.state.ranked) {
      const [x, y] = this.camera.toScreen(pane.rect, ...this.centreOf(pane.state, cell));
      const r = 6 * this.ratio;
      for (const [width, colour] of [[4, theme.halo], [1.5, theme.ink]]) {
        context.beginPath();
        context.arc(x, y, r, 0, 2 * Math.PI);
        context.lineWidth = width * this.ratio;
        context.strokeStyle = colour;
        context.stroke();
      }
      this.haloed(context, theme, String(rank), x + 1.3 * r, y - 0.6 * r);
    }
  }

  outline(context, pane, cell, theme, width) {
    const places = this.report.polygon(pane.state, cell);
    context.beginPath();
    places.forEach(([u, v], i) => {
      const [x, y] = this.camera.toScreen(pane.rect, u, v);
      if (i) context.lineTo(x, y);
      else context.moveTo(x, y);
    });
    context.closePath();
    for (const [extra, colour] of [[3, theme.halo], [0, theme.ink]]) {
      context.lineJoin = "round";
      context.lineWidth = (width + extra) * this.ratio;
      context.strokeStyle = colour;
      context.stroke();
    }
  }

  centreOf(state, cell) {
    const places = this.report.polygon(state, cell);
    const mean = (i) => places.reduce((sum, place) => sum + place[i], 0) / places.length;
    return [mean(0), mean(1)];
  }

  sizeOf(state, cell) {
    const places = this.report.polygon(state, cell);
    const span = (i) => {
      const all = places.map((place) => place[i]);
      return Math.max(...all) - Math.min(...all);
    };
    return Math.max(span(0), span(1)) || 1e-9;
  }

  // -------------------------------------------------------------------------------- flying

  flyTo(cell, side) {
    const pane = this.panes.find((one) => one.side === side);
    const [u, v] = this.centreOf(pane.state, cell);
    const size = this.sizeOf(pane.state, cell);
    const across = Math.min(pane.rect.width, pane.rect.height);
    const goal = { u, v, zoom: Math.min(across / 4 / size / this.camera.whole.scale, MAX_ZOOM) };
    const isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;
    return this.flight(goal, isStill ? 0 : FLIGHT);
  }

  // Ends a flight: something else moves the camera.
  stay() {
    this.flightNumber = (this.flightNumber || 0) + 1;
    this.isFlying = false;
  }

  flight(goal, duration) {
    const { u, v, zoom } = this.camera;
    const start = performance.now();
    this.stay();
    const number = this.flightNumber;
    this.isFlying = true;
    return new Promise((landed) => {
      const step = (now) => {
        if (number !== this.flightNumber) return landed();
        const t = duration ? Math.min(Math.max((now - start) / duration, 0), 1) : 1;
        const eased = t * t * (3 - 2 * t);
        this.camera.zoom = zoom * (goal.zoom / zoom) ** eased;
        // Weighed such that the goal nears evenly on the screen.
        const left = t === 1 ? 0 : (1 - eased) * (zoom / this.camera.zoom);
        this.camera.u = goal.u + (u - goal.u) * left;
        this.camera.v = goal.v + (v - goal.v) * left;
        this.moved();
        if (t === 1) this.ask();
        this.isFlying = t < 1;
        return t < 1 ? requestAnimationFrame(step) : requestAnimationFrame(() => landed());
      };
      requestAnimationFrame(step);
    });
  }
}

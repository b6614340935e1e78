// Pointer, wheel and keyboard on the pictures.

const KEY_STEP = 0.125; // of a pane
const KEY_ZOOM = 1.25;
const CLICK_SLACK = 4; // pixels that a click may slip

Object.assign(Stage.prototype, {
  listen() {
    const { element } = this;
    element.addEventListener("wheel", (event) => this.onWheel(event), { passive: false });
    element.addEventListener("pointerdown", (event) => this.onDown(event));
    element.addEventListener("pointermove", (event) => this.onMove(event));
    for (const end of ["pointerup", "pointercancel"]) {
      element.addEventListener(end, (event) => this.onUp(event));
    }
    element.addEventListener("pointerleave", () => this.hover(null));
    element.addEventListener("dblclick", (event) => this.zoomAt(this.place(event), 2));
    element.addEventListener("keydown", (event) => this.onKey(event));
  },

  place(event) {
    const box = this.element.getBoundingClientRect();
    return [(event.clientX - box.left) * this.ratio, (event.clientY - box.top) * this.ratio];
  },

  paneAt([x]) {
    const [left, right] = this.panes;
    return x < right.clip.x ? left : right;
  },

  zoomAt(place, factor) {
    const { rect } = this.paneAt(place);
    const [u, v] = this.camera.toPlane(rect, ...place);
    this.stay();
    const before = this.camera.scale;
    this.camera.zoom *= factor;
    const ratio = before / this.camera.scale;
    this.camera.u = u + (this.camera.u - u) * ratio;
    this.camera.v = v + (this.camera.v - v) * ratio;
    this.moved();
  },

  pan(x, y) {
    this.stay();
    this.camera.u -= x / this.camera.scale;
    this.camera.v += y / this.camera.scale;
    this.moved();
  },

  onWheel(event) {
    if (!this.panes) return;
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === 1 ? 30 : 1);
    this.zoomAt(this.place(event), Math.exp(-Math.min(Math.max(pixels, -300), 300) * 0.002));
  },

  onDown(event) {
    if (!this.panes || event.target === this.divide) return;
    this.element.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, this.place(event));
    this.slipped = this.pointers.size > 1 ? Infinity : 0;
  },

  onMove(event) {
    if (!this.panes || event.target === this.divide) return;
    const place = this.place(event);
    const before = this.pointers.get(event.pointerId);
    if (!before) return this.hover(place, event);
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId);
    this.pointers.set(event.pointerId, place);
    this.slipped += Math.hypot(place[0] - before[0], place[1] - before[1]);
    if (others.length === 1) this.pinch(others[0][1], before, place);
    else if (this.slipped > CLICK_SLACK * this.ratio) this.pan(place[0] - before[0], place[1] - before[1]);
  },

  pinch(still, before, place) {
    const apart = ([x, y]) => Math.hypot(x - still[0], y - still[1]) || 1;
    const middle = [(still[0] + place[0]) / 2, (still[1] + place[1]) / 2];
    this.pan((place[0] - before[0]) / 2, (place[1] - before[1]) / 2);
    this.zoomAt(middle, apart(place) / apart(before));
  },

  onUp(event) {
    if (!this.pointers.delete(event.pointerId)) return;
    const isClick = event.type === "pointerup" && this.slipped <= CLICK_SLACK * this.ratio;
    if (isClick) this.select(this.cellUnder(this.place(event)));
  },

  cellUnder(place) {
    const pane = this.paneAt(place);
    return pane.index().cellAt(...this.camera.toPlane(pane.rect, ...place));
  },

  hover(place, event) {
    const cell = place && this.panes ? this.cellUnder(place) : null;
    if (cell !== this.hovered) {
      this.hovered = cell;
      this.ask(DRAW.marks);
    }
    this.view.onHover(cell, event);
  },

  select(cell) {
    this.view.onSelect(cell);
    this.ask(DRAW.marks);
  },

  onKey(event) {
    if (!this.panes || event.target !== this.element) return;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { rect } = this.panes[0];
    const [x, y] = [rect.width * KEY_STEP, rect.height * KEY_STEP];
    const middle = [rect.x + rect.width / 2, rect.y + rect.height / 2];
    const actions = {
      ArrowLeft: () => this.pan(x, 0),
      ArrowRight: () => this.pan(-x, 0),
      ArrowUp: () => this.pan(0, y),
      ArrowDown: () => this.pan(0, -y),
      "+": () => this.zoomAt(middle, KEY_ZOOM),
      "=": () => this.zoomAt(middle, KEY_ZOOM),
      "-": () => this.zoomAt(middle, 1 / KEY_ZOOM),
      0: () => this.home(),
      Home: () => this.home(),
      Enter: () => this.select(this.cellUnder(middle)),
      Escape: () => this.select(null),
    };
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  },
});

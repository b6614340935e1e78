// Puts the parts together; the address keeps what is seen.

class Viewer {
  constructor(report) {
    this.report = report;
    const states = report.states;
    const usual = Number.isInteger(report.usual) ? report.usual : states.length - 1;
    this.choice = {
      left: states[0].name, right: states[usual].name, metric: report.metrics[0].name, layout: "two",
      scale: "range", low: NaN, high: NaN, map: "viridis", reverse: false, edges: true,
    };
    this.kept = null;
    this.selected = null;
  }

  async start() {
    const { report } = this;
    this.fillTexts();
    this.readAddress();
    await report.readCells();
    this.controls = buildMenus(document.getElementById("menus"), report, this.choice,
      (name, value) => this.change(name, value));
    this.view = {
      left: null, right: null, look: null, layout: this.choice.layout, selected: null,
      onHover: (cell, event) => this.hover(cell, event),
      onSelect: (cell) => this.select(cell),
    };
    this.stage = new Stage(report, this.view);
    this.histogram = new Histogram(document.getElementById("histogram"), (kept) => this.filter(kept));
    this.convergence = new Convergence(document.getElementById("convergence"), report);
    await this.update();
    this.stage.resize();
    this.applyAddress();
    this.select(this.selected);
    this.stage.element.addEventListener("moved", () => this.remember());
    for (const query of ["print", "(prefers-color-scheme: dark)"]) {
      matchMedia(query).addEventListener("change", () => this.stage.draw());
    }
    document.getElementById("notice").textContent = this.stage.isFlat
      ? "This browser has no WebGL 2 here: pictures are drawn more slowly." : "";
    await new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)));
    performance.mark("shown");
    this.readRest();
  }

  fillTexts() {
    const { report } = this;
    const nTriangles = report.cells.n_triangles, nQuads = report.cells.n_quads;
    const kinds = [[nQuads, "quads"], [nTriangles, "triangles"]].filter(([n]) => n);
    const cells = kinds.map(([n, kind]) => `${counted(n)} ${kind}`).join(" and ");
    document.getElementById("lead").textContent = `${cells}, ${counted(report.n_vertices)} vertices`;
    document.getElementById("program").textContent = `Written by ${report.program}`;
    showTable(document.getElementById("methods"), report);
    showWords(document.getElementById("words"), report);
  }

  states() {
    return [this.report.state(this.choice.left), this.report.state(this.choice.right)];
  }

  // Figures that a state lacks, such as changes of the first one, are shown as missing.
  async valuesOf(state, name) {
    if (state.values[name] !== undefined) return this.report.readValues(state, name);
    this.missing = this.missing || new Float32Array(this.report.n_cells).fill(NaN);
    return this.missing;
  }

  async update() {
    const { report, choice } = this;
    const asked = (this.asked = (this.asked || 0) + 1);
    const states = this.states(), metric = report.metric(choice.metric);
    await Promise.all(states.map((state) => report.readPoints(state)));
    const values = await Promise.all(states.map((state) => this.valuesOf(state, metric.name)));
    if (asked !== this.asked) return; // another choice has come in between
    for (const state of states) this.rank(state);
    this.view.left = { state: states[0], values: values[0] };
    this.view.right = { state: states[1], values: values[1] };
    this.view.layout = choice.layout;
    this.values = values;
    this.look();
    this.histogram.show(metric, states.map((state) => state.label), values, this.kept);
    this.convergence.prefer(metric.name);
    showWorst(document.getElementById("worst"), report, [["left", states[0]], ["right", states[1]]],
      (id, side) => this.fly(id, side));
    showChosen(document.getElementById("chosen"), report, states, this.selected);
    this.stage.arrange();
    this.remember();
  }

  rank(state) {
    state.ranked = worstCells(state).map((entries, k) => ({ cell: this.report.cellOf(entries[0].cell), rank: k + 1 }));
  }

  look() {
    const { choice, report } = this;
    const scale = new Scale(report.metric(choice.metric), this.values, choice);
    this.view.look = { scale, kept: this.kept, edges: choice.edges };
    for (const [name, value] of [["low", scale.low], ["high", scale.high]]) {
      this.controls[name].placeholder = plain(value, false);
      this.controls[name].disabled = scale.byQuantiles;
    }
    document.getElementById("legend").replaceChildren(
      made("p", {}, `Colour: ${scale.metric.label}`), legendSvg(scale));
  }

  change(name, value) {
    this.choice[name] = value;
    if (name === "metric") {
      Object.assign(this.choice, { low: NaN, high: NaN });
      this.controls.low.value = this.controls.high.value = "";
      this.kept = null;
    }
    if (["left", "right", "metric", "layout"].includes(name)) return void this.update().catch(failed);
    this.look();
    this.stage.ask();
    this.remember();
  }

  filter(kept) {
    this.kept = kept;
    this.view.look.kept = kept;
    this.stage.ask();
    this.remember();
  }

  hover(cell, event) {
    showTip(document.getElementById("tip"), this.stage.element, this.report, this.states(), cell, event);
  }

  select(cell) {
    this.selected = this.view.selected = cell;
    showChosen(document.getElementById("chosen"), this.report, this.states(), cell);
    this.stage.ask(DRAW.marks);
    this.remember();
  }

  fly(id, side = "right") {
    const cell = this.report.cellOf(id);
    if (cell === null) return Promise.reject(new RangeError(`there is no cell ${id}`));
    this.select(cell);
    document.getElementById("stage").scrollIntoView({ block: "nearest" });
    return this.stage.flyTo(cell, side);
  }

  // All other figures, so that hovering shows them, when nothing else is to be done.
  async readRest() {
    for (const state of this.report.states) {
      for (const name of Object.keys(state.values)) {
        await new Promise((rested) => setTimeout(rested, 0));
        await this.report.readValues(state, name);
      }
    }
    document.getElementById("tip").replaceChildren();
    showChosen(document.getElementById("chosen"), this.report, this.states(), this.selected);
    this.isComplete = true;
  }

  state() {
    const { choice, stage, report, selected, kept } = this;
    const isKept = (value) => !kept || (value >= kept[0] && value <= kept[1]);
    return {
      left: choice.left, right: choice.right, metric: choice.metric,
      centre: [stage.camera.u, stage.camera.v], zoom: stage.camera.zoom,
      selected: selected === null ? null : report.idOf(selected), filter: kept,
      drawnCells: this.values.map((values) => values.reduce((n, value) => n + isKept(value), 0)),
      isComplete: Boolean(this.isComplete), isFlat: Boolean(stage.isFlat),
      isFlying: Boolean(stage.isFlying),
    };
  }

  // ----------------------------------------------------------------------------- the address

  remember() {
    clearTimeout(this.remembering);
    this.remembering = setTimeout(() => {
      const { camera } = this.stage;
      const { left, right, metric } = this.choice;
      const parts = { left, right, metric, centre: `${camera.u},${camera.v}`, zoom: camera.zoom };
      if (this.kept) parts.filter = this.kept.join(",");
      if (this.selected !== null) parts.selected = this.report.idOf(this.selected);
      history.replaceState(null, "", `#${new URLSearchParams(parts)}`);
    }, 400);
  }

  readAddress() {
    const { report, choice } = this;
    this.address = new URLSearchParams(location.hash.slice(1));
    for (const name of ["left", "right"]) {
      if (report.state(this.address.get(name))) choice[name] = this.address.get(name);
    }
    if (report.metric(this.address.get("metric"))) choice.metric = this.address.get("metric");
    const filter = (this.address.get("filter") || "").split(",").map(Number);
    if (filter.length === 2 && !filter.some(Number.isNaN)) this.kept = filter;
  }

  applyAddress() {
    const { camera } = this.stage;
    const centre = (this.address.get("centre") || "").split(",").map(Number);
    const zoom = Number(this.address.get("zoom"));
    if (centre.length === 2 && centre.every(Number.isFinite)) [camera.u, camera.v] = centre;
    if (zoom > 0) camera.zoom = zoom;
    if (this.address.has("selected")) this.selected = this.report.cellOf(Number(this.address.get("selected")));
  }
}

function failed(error) {
  document.getElementById("notice").textContent = `The pictures cannot be shown: ${error.message}`;
  console.error(error);
}

const viewer = new Viewer(readReport());
window.qsmoothReport = {
  ready: viewer.start().catch(failed),
  state: () => viewer.state(),
  flyTo: (cell, side) => viewer.fly(cell, side),
};

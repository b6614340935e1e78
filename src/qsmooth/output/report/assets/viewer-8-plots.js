// Histograms and convergence, as SVG.

const SVG = "http://www.w3.org/2000/svg";
const N_BINS = 30;
const PLOT = { width: 620, height: 240, left: 52, right: 24, top: 12, bottom: 34 };
const DASHES = ["", "7 3", "2 3", "9 3 2 3", "1 2", "12 4", "4 2 1 2"];

function made(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

function drawn(tag, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

function svgPlot(label, height = PLOT.height) {
  return drawn("svg", { viewBox: `0 0 ${PLOT.width} ${height}`, role: "group", "aria-label": label });
}

function svgText(x, y, text, anchor = "middle") {
  return drawn("text", { x, y, "text-anchor": anchor }, text);
}

function axis(svg, x0, x1, y, ticks) {
  svg.append(drawn("line", { x1: x0, x2: x1, y1: y, y2: y, class: "axis" }));
  for (const [x, text] of ticks) {
    svg.append(drawn("line", { x1: x, x2: x, y1: y, y2: y + 4, class: "axis" }), svgText(x, y + 17, text));
  }
}

function legendSvg(scale) {
  const svg = svgPlot("Colours", 44);
  const [x0, width] = [PLOT.left, PLOT.width - 2 * PLOT.left];
  for (let k = 0; k < 128; k++) {
    const fill = cssColour(scale.colourOfShare((k + 0.5) / 128));
    svg.append(drawn("rect", { x: x0 + (k * width) / 128, y: 2, width: width / 128 + 0.6, height: 16, fill }));
  }
  const ticks = [0, 0.25, 0.5, 0.75, 1].map((t) => [x0 + t * width, formatted(scale.valueAt(t), scale.metric)]);
  axis(svg, x0, x0 + width, 18, ticks);
  return svg;
}

class Histogram {
  constructor(element, onFilter) {
    this.element = element;
    this.onFilter = onFilter;
    this.isLogarithmic = false;
    this.focused = 0;
  }

  show(metric, labels, arrays, kept) {
    Object.assign(this, { metric, labels, kept });
    this.bins = new Bins(metric, arrays, N_BINS);
    this.render();
  }

  render() {
    const { metric, labels, bins } = this;
    const toggle = made("input", { type: "checkbox", id: "log-counts", onchange: () => {
      this.isLogarithmic = toggle.checked;
      this.render();
      document.getElementById("log-counts").focus();
    } });
    toggle.checked = this.isLogarithmic;
    this.readout = made("output", {}, this.kept ? this.keptWords() : "Click, drag or Enter on bars shows only these cells.");
    const clear = made("button", { type: "button", onclick: () => this.filter(null) }, "Show all cells");
    clear.disabled = !this.kept;
    const key = labels.map((label, k) => made("span", { class: `key key-${k}` }, label));
    this.element.replaceChildren(
      made("h2", {}, `Cells by ${metric.label}`),
      made("p", { class: "row" }, ...key, made("label", {}, toggle, " logarithmic counts"), clear),
      this.plot(),
      made("p", {}, this.readout),
    );
  }

  keptWords() {
    const [low, high] = this.kept;
    return `Shown: ${formatted(low, this.metric)} to ${formatted(high, this.metric)}; others are grey.`;
  }

  plot() {
    const { bins } = this;
    const nShown = bins.n + (bins.hasInfinite ? 1 : 0);
    const most = Math.max(1, ...bins.counts.flatMap((counts) => [...counts]));
    const height = PLOT.height - PLOT.top - PLOT.bottom, floor = PLOT.top + height;
    const tall = (count) => height * (this.isLogarithmic ? Math.log10(1 + count) / Math.log10(1 + most) : count / most);
    const width = (PLOT.width - PLOT.left - PLOT.right) / nShown;
    const svg = svgPlot(`Histogram of ${this.metric.label}`);
    const group = drawn("g");
    for (let k = 0; k < nShown; k++) group.append(this.bar(k, PLOT.left + k * width, width, floor, height, tall));
    svg.append(group);
    const ticks = [0, 6, 12, 18, 24, 30].map((k) => [PLOT.left + k * width, formatted(bins.edge(k), this.metric)]);
    if (bins.hasInfinite) ticks[5] = [PLOT.left + (nShown - 0.5) * width, "∞"];
    axis(svg, PLOT.left, PLOT.width - PLOT.right, floor, ticks);
    svg.append(svgText(PLOT.left - 6, PLOT.top + 10, counted(most), "end"), svgText(PLOT.left - 6, floor, "0", "end"));
    this.bars = [...group.children];
    svg.addEventListener("pointerup", () => (this.pressed = null));
    svg.addEventListener("keydown", (event) => this.onKey(event, nShown));
    return svg;
  }

  bar(k, x, width, floor, height, tall) {
    const words = this.words(k);
    const isOff = this.kept && !this.overlaps(k);
    const bar = drawn("g", {
      class: `bin${isOff ? " off" : ""}`, role: "button", "aria-label": words, tabindex: k === this.focused ? 0 : -1,
    });
    bar.append(drawn("rect", { x, y: PLOT.top, width, height, class: "catch" }));
    this.bins.counts.forEach((counts, side) => {
      const full = counts[k] ? Math.max(1.5, tall(counts[k])) : 0;
      const place = { x: x + 1 + (side * (width - 2)) / 2, y: floor - full, width: (width - 2) / 2, height: full };
      bar.append(drawn("rect", { ...place, class: `bar key-${side}` }));
    });
    bar.append(drawn("title", {}, words));
    bar.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      this.pressed = k;
      this.filter([k, k]);
    });
    bar.addEventListener("pointerenter", (event) => {
      this.readout.textContent = words;
      if (this.pressed !== null && this.pressed !== undefined && event.buttons) {
        this.filter([Math.min(k, this.pressed), Math.max(k, this.pressed)]);
      }
    });
    bar.addEventListener("focus", () => (this.readout.textContent = words));
    return bar;
  }

  words(k) {
    const range = k === this.bins.n ? "infinite" : `${formatted(this.bins.edge(k), this.metric)} to ${formatted(this.bins.edge(k + 1), this.metric)}`;
    return `${range}: ${this.labels.map((label, side) => `${label} ${counted(this.bins.counts[side][k])}`).join(", ")}`;
  }

  overlaps(k) {
    const [low, high] = this.kept;
    if (k === this.bins.n) return high === Infinity;
    const middle = (this.bins.edge(k) + this.bins.edge(k + 1)) / 2;
    return middle >= low && middle <= high;
  }

  filter(range) {
    const top = range && (range[1] >= this.bins.n - 1 && !this.bins.hasInfinite ? this.bins.high : this.bins.edge(range[1] + 1));
    this.kept = range && [this.bins.edge(range[0]), top];
    if (range && range[0] === this.bins.n) this.kept = [Infinity, Infinity];
    this.bars.forEach((bar, k) => bar.classList.toggle("off", this.kept !== null && !this.overlaps(k)));
    this.element.querySelector("button").disabled = !this.kept;
    this.readout.textContent = this.kept ? this.keptWords() : "All cells are shown.";
    this.onFilter(this.kept);
  }

  onKey(event, n) {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (step) {
      this.bars[this.focused].setAttribute("tabindex", -1);
      this.focused = Math.min(Math.max(this.focused + step, 0), n - 1);
      this.bars[this.focused].setAttribute("tabindex", 0);
      this.bars[this.focused].focus();
      if (event.shiftKey && this.anchor !== undefined) {
        this.filter([Math.min(this.anchor, this.focused), Math.max(this.anchor, this.focused)]);
      }
    } else if (event.key === "Enter" || event.key === " ") {
      this.anchor = this.focused;
      this.filter([this.focused, this.focused]);
    } else if (event.key === "Escape") this.filter(null);
    else return;
    event.preventDefault();
  }
}

class Convergence {
  constructor(element, report) {
    this.element = element;
    this.report = report;
    this.states = report.states.filter((state) => state.history);
    this.names = [...new Set(this.states.flatMap((state) => state.history.names))];
    if (this.names.length) this.render(this.names[0]);
    else element.hidden = true;
  }

  prefer(metric) {
    if (this.names.includes(metric)) this.render(metric);
  }

  render(name) {
    const menu = made("select", { id: "quantity", onchange: () => {
      this.render(menu.value);
      document.getElementById("quantity").focus();
    } }, ...this.names.map((one) => made("option", { value: one }, this.label(one))));
    menu.value = name;
    this.element.replaceChildren(
      made("h2", {}, "Convergence"),
      made("p", { class: "row" }, made("label", {}, "Of ", menu)),
      this.plot(name),
    );
  }

  label(name) {
    const metric = this.report.metric(name);
    return metric ? metric.label : name.replaceAll("_", " ");
  }

  plot(name) {
    const isFinite = (value) => typeof value === "number" && Number.isFinite(value);
    const lines = this.states.map((state) => ({ state, rows: state.history.rows[name] || [] }))
      .filter(({ rows }) => rows.some(isFinite));
    const all = lines.flatMap(({ rows }) => rows.filter(isFinite));
    const low = Math.min(...all), high = Math.max(...all), isLevel = low === high;
    const most = Math.max(1, ...lines.map(({ rows }) => rows.length));
    const floor = PLOT.height - PLOT.bottom, right = PLOT.width - 130;
    const x = (k) => PLOT.left + ((right - PLOT.left) * (k + 0.5)) / most;
    const share = (value) => (isLevel ? 0.5 : (value - low) / (high - low));
    const y = (value) => floor - 10 - (floor - PLOT.top - 16) * share(value);
    const svg = svgPlot(`Convergence of ${this.label(name)}`);
    const metric = this.report.metric(name);
    const isOfSweeps = lines.every(({ state, rows }) => rows.length === state.sweeps);
    axis(svg, PLOT.left, right, floor, (most > 1 ? [0, most - 1] : [0]).map((k) => [x(k), `${k + 1}`]));
    svg.append(svgText((PLOT.left + right) / 2, floor + 30, `after so many ${isOfSweeps ? "sweeps" : "rounds of sweeps"}`));
    for (const value of isLevel ? [low] : [low, high]) svg.append(svgText(PLOT.left - 6, y(value) + 4, formatted(value, metric), "end"));
    lines.forEach(({ state, rows }, i) => {
      const points = rows.flatMap((value, k) => (isFinite(value) ? [`${x(k)},${y(value)}`] : [])).join(" ");
      const dash = { "stroke-dasharray": DASHES[i % DASHES.length] };
      const keyY = PLOT.top + 10 + 16 * i;
      svg.append(
        drawn("polyline", { points, class: "line", ...dash }),
        drawn("line", { x1: right + 8, x2: right + 32, y1: keyY, y2: keyY, class: "line", ...dash }),
        svgText(right + 37, keyY + 4, state.label, "start"),
      );
    });
    return svg;
  }
}

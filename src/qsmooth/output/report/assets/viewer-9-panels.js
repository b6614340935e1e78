// Menus, lists and tables.

function option(value, text) {
  return made("option", { value }, text);
}

function labelled(text, control) {
  return made("label", {}, made("span", {}, text), control);
}

function buildMenus(form, report, choice, onChange) {
  const controls = {
    left: menu(report.states.map((state) => option(state.name, state.label))),
    right: menu(report.states.map((state) => option(state.name, state.label))),
    metric: menu(report.metrics.map((metric) => option(metric.name, metric.label))),
    layout: menu([option("two", "side by side"), option("swipe", "swipe over")]),
    scale: menu([option("range", "even"), option("quantiles", "quantiles")]),
    low: made("input", { type: "number", step: "any" }),
    high: made("input", { type: "number", step: "any" }),
    map: menu(Object.keys(COLOUR_MAPS).map((name) => option(name, name))),
    reverse: made("input", { type: "checkbox" }),
    edges: made("input", { type: "checkbox" }),
  };
  const names = {
    left: "Left", right: "Right", metric: "Colour by", layout: "Layout", scale: "Scale", low: "from",
    high: "to", map: "Colours", reverse: "reversed", edges: "edges",
  };
  for (const [name, control] of Object.entries(controls)) {
    control.id = `menu-${name}`;
    if (control.type === "checkbox") control.checked = choice[name];
    else control.value = Number.isNaN(choice[name]) ? "" : choice[name];
    control.addEventListener("change", () => onChange(name, valueOf(control)));
    form.append(labelled(names[name], control));
  }
  form.addEventListener("submit", (event) => event.preventDefault());
  return controls;
}

function menu(options) {
  return made("select", {}, ...options);
}

function valueOf(control) {
  if (control.type === "checkbox") return control.checked;
  return control.type === "number" ? control.valueAsNumber : control.value;
}

// A cell's figures on both sides; the same table for what is under the pointer and what is chosen.
function figuresOf(report, states, cell) {
  const head = made("tr", {}, made("th", {}), ...states.map((state) => made("th", { scope: "col" }, state.label)));
  const rows = report.metrics.map((metric) => {
    const figures = states.map((state) => {
      const values = report.values(state, metric.name);
      return made("td", {}, values ? formatted(values[cell], metric) : "–");
    });
    return made("tr", { "data-metric": metric.name }, made("th", { scope: "row" }, metric.label), ...figures);
  });
  return made("table", {}, made("thead", {}, head), made("tbody", {}, ...rows));
}

function cellTitle(report, cell, states) {
  const kind = report.nCorners(cell) === 3 ? "triangle" : "quad";
  const invalid = states.filter((state) => state.shape.marks[cell] & INVALID).map((state) => state.label);
  const warning = invalid.length ? `, not valid: ${invalid.join(", ")}` : "";
  return `Cell ${report.idOf(cell)} (${kind}${warning})`;
}

function showChosen(element, report, states, cell) {
  if (cell === null) {
    element.replaceChildren(made("h2", {}, "Cell"), made("p", {}, "None is chosen: click one, or take one of the worst."));
    return;
  }
  const corners = [...report.cornersOf(cell)].map((v) => {
    const isFixed = report.fixedMarks !== null && report.fixedMarks[v];
    return `${v}${isFixed ? " (held)" : ""}`;
  });
  element.replaceChildren(
    made("h2", {}, cellTitle(report, cell, states)),
    figuresOf(report, states, cell),
    made("p", { class: "small" }, `Vertices ${corners.join(", ")}`),
  );
}

function showTip(tip, stage, report, states, cell, event) {
  tip.hidden = cell === null || !event;
  if (tip.hidden) return;
  if (tip.dataset.cell !== String(cell) || !tip.childElementCount) {
    tip.replaceChildren(made("strong", {}, cellTitle(report, cell, states)), figuresOf(report, states, cell));
    tip.dataset.cell = cell;
  }
  const box = stage.getBoundingClientRect();
  const [x, y] = [event.clientX - box.left, event.clientY - box.top];
  const isRight = x > box.width - tip.offsetWidth - 20, isLow = y > box.height - tip.offsetHeight - 20;
  tip.style.left = `${Math.max(0, isRight ? x - tip.offsetWidth - 14 : x + 14)}px`;
  tip.style.top = `${Math.max(0, isLow ? y - tip.offsetHeight - 14 : y + 14)}px`;
}

// Each cell once, with all that it is among the worst of.
function worstCells(state) {
  const byCell = new Map();
  for (const entry of state.worst || []) {
    if (!byCell.has(entry.cell)) byCell.set(entry.cell, []);
    byCell.get(entry.cell).push(entry);
  }
  return [...byCell.values()];
}

function worstButton(report, entries, onFly) {
  const [first] = entries;
  const figures = entries.map((entry) => {
    const metric = report.metric(entry.metric);
    const value = entry.values[entry.metric];
    return `${metric ? metric.label : entry.metric} ${formatted(value === null ? Infinity : value, metric)}`;
  });
  const reasons = [...new Set(entries.map((entry) => entry.why).filter(Boolean))];
  return made("button", { type: "button", "data-cell": first.cell, onclick: () => onFly(first.cell) },
    made("strong", {}, `Cell ${first.cell}`), ` ${figures.join(", ")}`,
    ...reasons.map((why) => made("span", { class: "why" }, why)));
}

function showWorst(element, report, sides, onFly) {
  const lists = sides.map(([side, state]) => {
    const items = worstCells(state).map((entries) =>
      made("li", {}, worstButton(report, entries, (cell) => onFly(cell, side))));
    const list = items.length ? made("ol", {}, ...items) : made("p", {}, "No list of this state.");
    return made("div", { class: "worst-list" }, made("h2", {}, `Worst cells: ${state.label}`), list);
  });
  element.replaceChildren(...lists);
}

function showTable(element, report) {
  const { table, notes = [] } = report;
  if (!table || !table.rows.length) {
    element.hidden = true;
    return;
  }
  const isBest = (row, column) => table.best.some(([r, c]) => r === row && c === column);
  const head = made("tr", {}, ...table.columns.map((text) => made("th", { scope: "col" }, text)));
  const rows = table.rows.map((row, r) => made("tr", {}, ...row.map((text, c) =>
    c === 0 ? made("th", { scope: "row" }, text) : made("td", isBest(r, c) ? { class: "best" } : {}, text))));
  const words = table.best.length ? [made("p", { class: "small" }, "Bold and underlined: the best of a row.")] : [];
  element.replaceChildren(made("h2", {}, "All states in figures"),
    made("div", { class: "wide" }, made("table", {}, made("thead", {}, head), made("tbody", {}, ...rows))),
    ...words, ...notes.map((note) => made("p", { class: "small" }, note)));
}

function sentence(text) {
  return !text || /[.!?]$/.test(text) ? text : `${text}.`;
}

function showWords(element, report) {
  const topics = { limits: "What no placement can beat", promised: "Promised", traded: "Traded", sizes: "Sizes" };
  const parts = report.states.flatMap((state) => {
    const lists = Object.entries(topics).filter(([name]) => (state[name] || []).length).flatMap(([name, title]) =>
      [made("h3", {}, title), made("ul", {}, ...state[name].map((sentence) => made("li", {}, sentence)))]);
    const facts = [
      state.n_invalid ? `${counted(state.n_invalid)} ${state.n_invalid === 1 ? "cell is" : "cells are"} not valid.` : "Every cell is valid.",
      sentence(state.reason),
      state.seconds ? `${state.seconds.toPrecision(2)} s, ${counted(state.sweeps)} ${state.sweeps === 1 ? "sweep" : "sweeps"}.` : null,
    ].filter(Boolean);
    return [made("div", { class: "state-words" }, made("h2", {}, state.label), made("p", {}, facts.join(" ")), ...lists)];
  });
  element.replaceChildren(...parts);
}

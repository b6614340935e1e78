"use strict";

// The file's content: JSON, and arrays that are unpacked when first asked for.

const ARRAY_TYPES = { f4: Float32Array, u4: Uint32Array, u1: Uint8Array };

function bytesOfBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const letters = atob(text);
  const bytes = new Uint8Array(letters.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = letters.charCodeAt(i);
  return bytes;
}

// From all first bytes, all second ones and so on, which pack better, to values of four bytes.
function interleaved(planes) {
  const n = planes.length / 4;
  const bytes = new Uint8Array(planes.length);
  for (let i = 0; i < n; i++) {
    for (let b = 0; b < 4; b++) bytes[4 * i + b] = planes[b * n + i];
  }
  return bytes;
}

async function unpacked(element, record) {
  const packed = bytesOfBase64(element.textContent.trim());
  element.textContent = ""; // a million quads have tens of megabytes of text
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const array = new ARRAY_TYPES[record.type]((record.planes ? interleaved(bytes) : bytes).buffer);
  if (record.delta) for (let i = 1; i < array.length; i++) array[i] += array[i - 1];
  if (array.length !== record.length) throw new Error("an array of this report is damaged");
  return array;
}

class Report {
  constructor(content) {
    Object.assign(this, content);
    this.arrayPromises = new Map();
    this.valuesAt = new Map();
  }

  array(key) {
    if (!this.arrayPromises.has(key)) {
      const element = document.getElementById(`array-${key}`);
      this.arrayPromises.set(key, unpacked(element, this.arrays[key]));
    }
    return this.arrayPromises.get(key);
  }

  metric(name) {
    return this.metrics.find((metric) => metric.name === name);
  }

  state(name) {
    return this.states.find((state) => state.name === name);
  }

  async readCells() {
    const { triangles, quads, n_triangles: nTriangles, n_quads: nQuads, ids } = this.cells;
    this.corners = new Uint32Array(4 * (nTriangles + nQuads));
    if (nTriangles) {
      const from = await this.array(triangles);
      for (let c = 0; c < nTriangles; c++) {
        this.corners.set(from.subarray(3 * c, 3 * c + 3), 4 * c);
        this.corners[4 * c + 3] = from[3 * c + 2]; // a triangle is a quad with its last corner twice
      }
    }
    if (nQuads) this.corners.set(await this.array(quads), 4 * nTriangles);
    this.ids = ids === null ? null : await this.array(ids);
    this.fixedMarks = this.fixed === null ? null : await this.array(this.fixed);
  }

  async readPoints(state) {
    if (state.uv) return;
    const uv = await this.array(state.points);
    state.invalidMarks = await this.invalidMarksOf(state);
    state.shape = shapeOf(uv, this.corners, state.invalidMarks);
    state.uv = uv;
  }

  async invalidMarksOf(state) {
    if (Number.isInteger(state.invalid)) return this.array(state.invalid);
    if (state.values.scaled_jacobian === undefined) return null;
    const jacobians = await this.readValues(state, "scaled_jacobian");
    return Uint8Array.from(jacobians, (value) => (value > 0 ? 0 : 1));
  }

  async readValues(state, name) {
    const values = await this.array(state.values[name]);
    this.valuesAt.set(`${state.name}/${name}`, values);
    return values;
  }

  // What has been read already, or undefined.
  values(state, name) {
    return this.valuesAt.get(`${state.name}/${name}`);
  }

  // The caller's number of a cell, of its place in the file, and the way back.
  idOf(cell) {
    return this.ids === null ? cell : this.ids[cell];
  }

  cellOf(id) {
    if (!Number.isInteger(id) || id < 0 || id >= this.n_cells) return null;
    if (this.ids === null) return id;
    if (!this.cellAt) {
      this.cellAt = new Uint32Array(this.n_cells);
      for (let c = 0; c < this.n_cells; c++) this.cellAt[this.ids[c]] = c;
    }
    return this.cellAt[id];
  }

  nCorners(cell) {
    return this.corners[4 * cell + 2] === this.corners[4 * cell + 3] ? 3 : 4;
  }

  cornersOf(cell) {
    return this.corners.subarray(4 * cell, 4 * cell + this.nCorners(cell));
  }

  polygon(state, cell) {
    return Array.from(this.cornersOf(cell), (v) => [state.uv[2 * v], state.uv[2 * v + 1]]);
  }
}

function readReport() {
  return new Report(JSON.parse(document.getElementById("data").textContent));
}

const CHUNK = 4096; // cells that are drawn or left out together
const INVALID = 1;
const OTHER_DIAGONAL = 2;

// What drawing asks of a state: marks of cells, boxes of chunks, the extent, how large cells are.
function shapeOf(uv, corners, invalid) {
  const n = corners.length / 4;
  const marks = new Uint8Array(n);
  const boxes = new Float64Array(4 * Math.ceil(n / CHUNK));
  const sizes = [];
  const stride = Math.max(1, Math.floor(n / 5000));
  const box = new Float64Array(4);
  for (let chunk = 0; 4 * chunk < boxes.length; chunk++) {
    emptyBox(box);
    const stop = Math.min(n, (chunk + 1) * CHUNK);
    for (let c = chunk * CHUNK; c < stop; c++) {
      growBox(box, uv, corners, c);
      const [low, high] = halves(uv, corners, c, 0);
      if ((low < 0) !== (high < 0) && low * high !== 0) {
        const [first, second] = halves(uv, corners, c, 1);
        if ((first < 0) === (second < 0)) marks[c] |= OTHER_DIAGONAL;
      }
      if (invalid !== null && invalid[c]) marks[c] |= INVALID;
      if (c % stride === 0) sizes.push(Math.sqrt(Math.abs(low + high) / 2));
    }
    boxes.set(box, 4 * chunk);
  }
  sizes.sort((a, b) => a - b);
  const large = sizes[Math.floor(0.98 * (sizes.length - 1))];
  return { marks, boxes, extent: unionOf(boxes), large };
}

// Twice the areas of the two triangles that a quad is cut into.
function halves(uv, corners, cell, turn) {
  const at = (i) => 2 * corners[4 * cell + ((i + turn) & 3)];
  const a = at(0), b = at(1), c = at(2), d = at(3);
  const twice = (p, q, r) =>
    (uv[q] - uv[p]) * (uv[r + 1] - uv[p + 1]) - (uv[q + 1] - uv[p + 1]) * (uv[r] - uv[p]);
  return [twice(a, b, c), twice(a, c, d)];
}

// Boxes are low u, low v, high u, high v.
function emptyBox(box) {
  box[0] = box[1] = Infinity;
  box[2] = box[3] = -Infinity;
}

function growBox(box, uv, corners, cell) {
  for (let i = 4 * cell; i < 4 * cell + 4; i++) {
    const u = uv[2 * corners[i]], v = uv[2 * corners[i] + 1];
    if (u < box[0]) box[0] = u;
    if (u > box[2]) box[2] = u;
    if (v < box[1]) box[1] = v;
    if (v > box[3]) box[3] = v;
  }
}

function unionOf(boxes) {
  const all = new Float64Array(4);
  emptyBox(all);
  for (let k = 0; k < boxes.length; k += 4) {
    all[0] = Math.min(all[0], boxes[k]);
    all[1] = Math.min(all[1], boxes[k + 1]);
    all[2] = Math.max(all[2], boxes[k + 2]);
    all[3] = Math.max(all[3], boxes[k + 3]);
  }
  return all;
}

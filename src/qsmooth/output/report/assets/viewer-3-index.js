// Which cell is at a place: boxes of boxes over cells in the order of a space-filling curve, which
// do not mind how unevenly a mesh is graded.

const BRANCH = 8;

function spread(x) {
  x = (x | (x << 8)) & 0x00ff00ff;
  x = (x | (x << 4)) & 0x0f0f0f0f;
  x = (x | (x << 2)) & 0x33333333;
  return (x | (x << 1)) & 0x55555555;
}

function curveOrder(uv, corners, extent) {
  const n = corners.length / 4;
  const size = Math.max(extent[2] - extent[0], extent[3] - extent[1]) || 1;
  const keyed = new Float64Array(n); // the key above, the cell below: sorted as plain numbers
  for (let c = 0; c < n; c++) {
    const a = 2 * corners[4 * c], b = 2 * corners[4 * c + 2];
    const x = (65535 * ((uv[a] + uv[b]) / 2 - extent[0])) / size;
    const y = (65535 * ((uv[a + 1] + uv[b + 1]) / 2 - extent[1])) / size;
    keyed[c] = ((spread(x & 65535) | (spread(y & 65535) << 1)) >>> 0) * 2097152 + (c & 2097151);
  }
  if (n > 2097152) return Uint32Array.from({ length: n }, (_, c) => c);
  return Uint32Array.from(keyed.sort(), (key) => key % 2097152);
}

class CellIndex {
  constructor(uv, corners, extent, order = null) {
    this.uv = uv;
    this.corners = corners;
    this.order = order || curveOrder(uv, corners, extent);
    this.levels = [this.leaves()];
    while (this.levels[0].length > 4 * BRANCH) this.levels.unshift(this.above(this.levels[0]));
  }

  leaves() {
    const n = this.order.length;
    const boxes = new Float32Array(4 * Math.ceil(n / BRANCH));
    const box = new Float64Array(4);
    for (let k = 0; 4 * k < boxes.length; k++) {
      emptyBox(box);
      const stop = Math.min(n, (k + 1) * BRANCH);
      for (let i = k * BRANCH; i < stop; i++) growBox(box, this.uv, this.corners, this.order[i]);
      boxes.set(box, 4 * k);
    }
    return boxes;
  }

  above(boxes) {
    const n = Math.ceil(boxes.length / 4 / BRANCH);
    const parents = new Float32Array(4 * n);
    for (let k = 0; k < n; k++) {
      parents.set(unionOf(boxes.subarray(4 * k * BRANCH, 4 * (k + 1) * BRANCH)), 4 * k);
    }
    return parents;
  }

  // Calls `visit` with each cell whose leaf meets the box, until it returns true.
  visit(box, visit) {
    const descend = (level, k) => {
      const boxes = this.levels[level], b = 4 * k;
      if (boxes[b] > box[2] || boxes[b + 2] < box[0]) return false;
      if (boxes[b + 1] > box[3] || boxes[b + 3] < box[1]) return false;
      const isLeaf = level === this.levels.length - 1;
      const n = isLeaf ? this.order.length : this.levels[level + 1].length / 4;
      const stop = Math.min(n, (k + 1) * BRANCH);
      for (let i = k * BRANCH; i < stop; i++) {
        if (isLeaf ? visit(this.order[i]) : descend(level + 1, i)) return true;
      }
      return false;
    };
    for (let k = 0; 4 * k < this.levels[0].length; k++) if (descend(0, k)) return;
  }

  cellAt(u, v) {
    let found = null;
    this.visit([u, v, u, v], (cell) => {
      if (this.holds(cell, u, v)) found = cell;
      return found !== null;
    });
    return found;
  }

  holds(cell, u, v) {
    const { uv, corners } = this;
    let inside = false;
    for (let i = 0, j = 3; i < 4; j = i++) {
      const a = 2 * corners[4 * cell + i], b = 2 * corners[4 * cell + j];
      const isAcross = uv[a + 1] > v !== uv[b + 1] > v;
      if (!isAcross) continue;
      const share = (v - uv[a + 1]) / (uv[b + 1] - uv[a + 1]);
      if (u < uv[a] + share * (uv[b] - uv[a])) inside = !inside;
    }
    return inside;
  }
}

// Cells drawn by WebGL 2: what is known of vertices and cells lies in textures, and the shaders look
// it up by the number of the vertex being drawn. Nothing is sent again when colours change.

const TEXTURE_WIDTH = 4096;
const EDGES_FROM = 3; // pixels across a cell from which its edges begin to show

const SHADER_HEAD = `#version 300 es
precision highp float; precision highp int; precision highp sampler2D; precision highp usampler2D;
uniform sampler2D points, values; uniform usampler2D corners, marks;
uniform vec4 view; uniform vec2 pixels;
ivec2 at(uint i) { return ivec2(int(i & 4095u), int(i >> 12u)); }
vec2 place(uint v) { return texelFetch(points, at(v), 0).xy; }
vec4 onScreen(vec2 p) { return vec4((p - view.xy) * view.zw, 0.0, 1.0); }
`;

const CELL_VERTEX = `${SHADER_HEAD}
uniform float breaks[${N_BREAKS}]; uniform vec4 scale; uniform vec2 kept; uniform int byQuantiles;
flat out float share; flat out int kind;
const uint TABLE[6] = uint[6](0u, 1u, 2u, 0u, 2u, 3u);
float rank(float x) {
  int low = 0, high = ${N_BREAKS - 1};
  for (int i = 0; i < 6; i++) {
    if (high - low <= 1) break;
    int middle = (low + high) >> 1;
    if (x >= breaks[middle]) low = middle; else high = middle;
  }
  float width = breaks[high] - breaks[low];
  float inside = width > 0.0 ? (x - breaks[low]) / width : (x > breaks[low] ? 1.0 : 0.0);
  return (float(low) + clamp(inside, 0.0, 1.0)) / ${N_BREAKS - 1}.0;
}
void main() {
  uint cell = uint(gl_VertexID) / 6u;
  uint mark = texelFetch(marks, at(cell), 0).x;
  uint k = (TABLE[uint(gl_VertexID) % 6u] + ((mark & 2u) >> 1u)) & 3u;
  gl_Position = onScreen(place(texelFetch(corners, at(cell), 0)[k]));
  float x = texelFetch(values, at(cell), 0).x;
  bool isKept = x >= kept.x && x <= kept.y;
  kind = isKept ? ((mark & 1u) != 0u ? 2 : (isnan(x) ? 3 : 0)) : 1;
  float t = scale.z > 0.5 ? log(x / scale.x) / log(scale.y / scale.x) : (x - scale.x) / (scale.y - scale.x);
  if (isinf(x)) t = x > 0.0 ? 1.0 : 0.0;
  share = byQuantiles == 1 ? rank(x) : clamp(t, 0.0, 1.0);
  if (scale.w > 0.5) share = 1.0 - share;
}`;

const CELL_FRAGMENT = `${SHADER_HEAD}
uniform sampler2D colours; uniform vec3 away;
flat in float share; flat in int kind; out vec4 colour;
void main() {
  vec3 own = texelFetch(colours, ivec2(int(share * 255.0 + 0.5), 0), 0).rgb;
  bool stripe = mod(gl_FragCoord.x + gl_FragCoord.y, 7.0) < 3.5;
  if (kind == 2) own = stripe ? vec3(0.0) : vec3(1.0);
  if (kind == 1 || kind == 3) own = away;
  colour = vec4(own, 1.0);
}`;

const EDGE_VERTEX = `${SHADER_HEAD}
out float strength;
void main() {
  uint n = uint(gl_VertexID);
  uvec4 v = texelFetch(corners, at(n / 8u), 0);
  uint k = ((n % 8u) + 1u) >> 1u;
  vec2 a = place(v.x), b = place(v.y), c = place(v.z), d = place(v.w);
  vec2 ac = (c - a) * pixels, bd = (d - b) * pixels;
  float across = sqrt(abs(ac.x * bd.y - ac.y * bd.x) * 0.5);
  strength = smoothstep(${EDGES_FROM}.0, 14.0, across) * 0.6;
  gl_Position = onScreen(place(v[k & 3u]));
}`;

const EDGE_FRAGMENT = `${SHADER_HEAD}
uniform vec3 ink; in float strength; out vec4 colour;
void main() { colour = vec4(ink * strength, strength); }`;

function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  const places = new Map();
  return {
    program: made,
    at(name) {
      if (!places.has(name)) places.set(name, gl.getUniformLocation(made, name));
      return places.get(name);
    },
  };
}

// A triangle of 3 corners draws its last one twice: its second half and fourth edge have no extent.
class GlPainter {
  constructor(canvas, report) {
    const gl = canvas.getContext("webgl2", {
      antialias: report.n_cells < 200000, alpha: true, preserveDrawingBuffer: true,
    });
    if (!gl) throw new Error("no WebGL 2");
    Object.assign(this, { gl, canvas, report, textures: new Map() });
    this.cellProgram = program(gl, CELL_VERTEX, CELL_FRAGMENT);
    this.edgeProgram = program(gl, EDGE_VERTEX, EDGE_FRAGMENT);
    this.formats = {
      points: [gl.RG32F, gl.RG, gl.FLOAT, 2],
      values: [gl.R32F, gl.RED, gl.FLOAT, 1],
      corners: [gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT, 4],
      marks: [gl.R8UI, gl.RED_INTEGER, gl.UNSIGNED_BYTE, 1],
      colours: [gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, 4],
    };
    gl.bindVertexArray(gl.createVertexArray());
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.enable(gl.SCISSOR_TEST);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  texture(kind, array) {
    if (this.textures.has(array)) return this.textures.get(array);
    const { gl } = this;
    const [inside, format, type, width] = this.formats[kind];
    const n = array.length / width;
    const rows = Math.floor(n / TEXTURE_WIDTH), rest = n % TEXTURE_WIDTH;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, inside, Math.min(n, TEXTURE_WIDTH), rows + (rest > 0));
    const put = (row, columns, lines, part) =>
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, row, columns, lines, format, type, part);
    const full = rows * TEXTURE_WIDTH * width;
    if (rows) put(0, TEXTURE_WIDTH, rows, array.subarray(0, full));
    if (rest) put(rows, rest, 1, array.subarray(full));
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    this.textures.set(array, texture);
    return texture;
  }

  colourTable(scale) {
    const key = scale.map;
    if (this.tableKey !== key) {
      const shares = Array.from({ length: 256 }, (_, k) => [...colourAt(key, k / 255), 255]);
      this.table = Uint8Array.from(shares.flat());
      this.tableKey = key;
    }
    return this.table;
  }

  bind(shader, textures) {
    const { gl } = this;
    gl.useProgram(shader.program);
    textures.forEach(([kind, array], unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, this.texture(kind, array));
      gl.uniform1i(shader.at(kind), unit);
    });
  }

  begin(theme) {
    const { gl, canvas } = this;
    gl.scissor(0, 0, canvas.width, canvas.height);
    gl.clearColor(...theme.paper.map((channel) => channel / 255), 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
  }

  // A pane has a rectangle and a clip in device pixels from the top left.
  draw(pane, camera, look) {
    const { gl, canvas, report } = this;
    const { rect, clip, state, values } = pane;
    gl.viewport(rect.x, canvas.height - rect.y - rect.height, rect.width, rect.height);
    gl.scissor(clip.x, canvas.height - clip.y - clip.height, clip.width, clip.height);
    const runs = this.visibleRuns(pane, camera);
    const of = [["points", state.uv], ["corners", report.corners]];
    const shader = this.cellProgram;
    this.bind(shader, [...of, ["marks", state.shape.marks], ["values", values],
      ["colours", this.colourTable(look.scale)]]);
    this.setView(shader, rect, camera);
    const { scale, kept, theme } = look;
    gl.uniform1fv(shader.at("breaks"), scale.breaks);
    gl.uniform4f(shader.at("scale"), scale.low, scale.high, Number(scale.logarithmic), Number(scale.flipped));
    gl.uniform2f(shader.at("kept"), kept ? kept[0] : -Infinity, kept ? kept[1] : Infinity);
    gl.uniform1i(shader.at("byQuantiles"), Number(scale.byQuantiles));
    gl.uniform3f(shader.at("away"), ...theme.away.map((channel) => channel / 255));
    for (const [first, stop] of runs) gl.drawArrays(gl.TRIANGLES, 6 * first, 6 * (stop - first));
    if (!look.edges || state.shape.large * camera.scale < EDGES_FROM) return;
    this.bind(this.edgeProgram, of);
    this.setView(this.edgeProgram, rect, camera);
    gl.uniform3f(this.edgeProgram.at("ink"), 0, 0, 0);
    gl.enable(gl.BLEND);
    for (const [first, stop] of runs) gl.drawArrays(gl.LINES, 8 * first, 8 * (stop - first));
    gl.disable(gl.BLEND);
  }

  setView(shader, rect, camera) {
    const { gl } = this;
    const [x, y] = [(2 * camera.scale) / rect.width, (2 * camera.scale) / rect.height];
    gl.uniform4f(shader.at("view"), camera.u, camera.v, x, y);
    gl.uniform2f(shader.at("pixels"), camera.scale, camera.scale);
  }

  // Ranges of cells whose chunks meet the pane: one where all is in sight.
  visibleRuns(pane, camera) {
    const { boxes } = pane.state.shape;
    const half = [pane.rect.width / 2 / camera.scale, pane.rect.height / 2 / camera.scale];
    const runs = [];
    for (let chunk = 0; 4 * chunk < boxes.length; chunk++) {
      const [lowU, lowV, highU, highV] = boxes.subarray(4 * chunk, 4 * chunk + 4);
      if (highU < camera.u - half[0] || lowU > camera.u + half[0]) continue;
      if (highV < camera.v - half[1] || lowV > camera.v + half[1]) continue;
      const first = chunk * CHUNK, stop = Math.min(first + CHUNK, this.report.n_cells);
      const last = runs[runs.length - 1];
      if (last && last[1] === first) last[1] = stop;
      else runs.push([first, stop]);
    }
    return runs;
  }
}

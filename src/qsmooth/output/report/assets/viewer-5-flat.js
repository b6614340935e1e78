// Cells drawn without WebGL, on a plain canvas: slower, and coarser where there are very many.

const FLAT_LIMIT = 60000; // cells of a pane that are drawn as polygons

class FlatPainter {
  constructor(canvas, report) {
    this.canvas = canvas;
    this.report = report;
    this.context = canvas.getContext("2d");
  }

  begin(theme) {
    this.context.fillStyle = cssColour(theme.paper);
    this.context.fillRect(0, 0, this.canvas.width, this.canvas.height);
  }

  draw(pane, camera, look) {
    const { context } = this;
    const { clip, rect } = pane;
    const half = [rect.width / 2 / camera.scale, rect.height / 2 / camera.scale];
    const box = [camera.u - half[0], camera.v - half[1], camera.u + half[0], camera.v + half[1]];
    const cells = [];
    pane.index().visit(box, (cell) => void cells.push(cell));
    const stride = Math.ceil(cells.length / FLAT_LIMIT);
    context.save();
    context.beginPath();
    context.rect(clip.x, clip.y, clip.width, clip.height);
    context.clip();
    for (let i = 0; i < cells.length; i += stride) this.drawCell(pane, camera, look, cells[i], stride);
    context.restore();
  }

  drawCell(pane, camera, look, cell, stride) {
    const { context, report } = this;
    const value = pane.values[cell];
    const isKept = !look.kept || (value >= look.kept[0] && value <= look.kept[1]);
    const isInvalid = pane.state.shape.marks[cell] & INVALID;
    const colour = cssColour(isKept && !Number.isNaN(value) ? look.scale.colour(value) : look.theme.away);
    const places = report.polygon(pane.state, cell).map(([u, v]) => camera.toScreen(pane.rect, u, v));
    context.beginPath();
    places.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.closePath();
    context.fillStyle = isInvalid && isKept ? "#fff" : colour;
    context.fill();
    context.lineWidth = stride > 1 ? 2 * Math.sqrt(stride) : 1;
    context.strokeStyle = isInvalid && isKept ? "#000" : colour;
    const isLarge = pane.state.shape.large * camera.scale > 2 * EDGES_FROM;
    if (look.edges && isLarge && stride === 1) context.strokeStyle = "rgba(0,0,0,.5)";
    context.stroke();
  }
}

// Where a picture takes long to draw, what moves is the last one; the new one comes once it rests.

const SLOW = 120; // milliseconds of a picture from which on it is moved instead
const POLL = 8;

// What has to be drawn: marks alone, the same at another place, all.
const DRAW = { nothing: 0, marks: 1, moved: 2, all: 3 };

Object.assign(Stage.prototype, {
  rest: 160, // milliseconds without a move until it is drawn anew

  ask(what = DRAW.all) {
    if (!this.asked) requestAnimationFrame(() => this.draw());
    this.asked = Math.max(this.asked || DRAW.nothing, what);
  },

  draw() {
    const asked = this.asked;
    this.asked = DRAW.nothing;
    if (!this.panes) return;
    const look = { ...this.view.look, theme: themeNow() };
    if (asked === DRAW.moved && this.isSlow && this.hasStill) {
      this.showStill();
    } else if (asked === DRAW.moved && this.isPainting) {
      this.isLate = true; // pictures must not queue up
      return;
    } else if (asked !== DRAW.marks) {
      this.drawCells(look);
    }
    this.drawMarks(look.theme);
  },

  drawCells(look) {
    clearTimeout(this.resting);
    const begin = performance.now();
    this.painter.begin(look.theme);
    for (const pane of this.panes) {
      if (pane.clip.width > 0) this.painter.draw(pane, this.camera, look);
    }
    this.showsStill = this.hasStill = this.isLate = false;
    this.isPainting = true;
    const number = (this.pictures = (this.pictures || 0) + 1);
    const { u, v, scale } = this.camera;
    this.painter.whenDone(() => {
      if (number !== this.pictures) return; // a later one is on its way
      this.isPainting = false;
      this.isSlow = performance.now() - begin > SLOW;
      if (this.isSlow) this.keepStill({ u, v, scale });
      if (this.isLate) this.ask(DRAW.moved);
    });
  },

  keepStill(camera) {
    const { width, height } = this.canvas;
    this.still = this.still || document.createElement("canvas");
    Object.assign(this.still, { width, height });
    this.still.getContext("2d").drawImage(this.canvas, 0, 0);
    this.stillCamera = camera;
    this.hasStill = true;
  },

  showStill() {
    this.showsStill = true;
    clearTimeout(this.resting);
    this.resting = setTimeout(() => this.ask(), this.rest);
  },

  // Within a pane's clip, under its marks.
  drawStill(context, { rect, clip }, theme) {
    context.fillStyle = cssColour(theme.paper);
    context.fillRect(clip.x, clip.y, clip.width, clip.height);
    const { u, v, scale } = this.stillCamera;
    const ratio = this.camera.scale / scale;
    const [x, y] = this.camera.toScreen(rect, u, v); // where the still's middle is now
    const [left, top] = [rect.x + rect.width / 2, rect.y + rect.height / 2];
    context.drawImage(
      this.still, clip.x, clip.y, clip.width, clip.height,
      x + (clip.x - left) * ratio, y + (clip.y - top) * ratio, clip.width * ratio, clip.height * ratio,
    );
  },
});

GlPainter.prototype.whenDone = function whenDone(done) {
  const { gl } = this;
  const sync = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  gl.flush();
  const look = () => {
    const isDone = gl.isContextLost() || gl.getSyncParameter(sync, gl.SYNC_STATUS) === gl.SIGNALED;
    if (!isDone) return setTimeout(look, POLL);
    gl.deleteSync(sync);
    return done();
  };
  setTimeout(look, 0);
};

FlatPainter.prototype.whenDone = (done) => done();

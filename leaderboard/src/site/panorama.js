// Panoramas to look around in: a rendering and its ground truth, drawn in perspective on a canvas as
// one small piece of the sphere after the other. Pages opened from files may draw images and not read
// them, so that WebGL is out of reach here. All panoramas of a page look into one direction.

class LookAround {
  static columns = 64;
  static rows = 32;
  // Degrees: width of what is seen, and where it ends.
  static limits = { first: 100, least: 25, most: 120 };
  // Pixels around the sphere below which a part of it would be a blur: such panoramas are shown whole at first.
  static sharp = 2048;

  constructor(figures) {
    this.toggle = document.querySelector("input.look-around");
    if (this.toggle && figures.some((figure) => Number(figure.dataset.width) < LookAround.sharp)) this.toggle.checked = false;
    this.views = figures.map((figure) => new SphereView(figure, this));
    this.corners = LookAround.sphere();
    this.ahead();
    const tools = document.querySelector(".look-tools");
    if (tools) {
      tools.hidden = false;
      const ahead = tools.querySelector(".look-ahead");
      ahead.disabled = !this.isOn;
      this.toggle.addEventListener("change", () => {
        ahead.disabled = !this.isOn;
        this.change();
      });
      ahead.addEventListener("click", () => {
        this.ahead();
        this.change();
      });
    }
    this.seen = new IntersectionObserver((entries) => {
      for (const { target, isIntersecting } of entries) {
        const view = this.views.find((each) => each.stage === target);
        view.isSeen = isIntersecting;
      }
      this.change();
    }, { rootMargin: "100px" });
    for (const view of this.views) this.seen.observe(view.stage);
    new ResizeObserver(() => this.change()).observe(document.body);
  }

  get isOn() {
    return this.toggle?.checked ?? true;
  }

  // Directions of the corners of all pieces, row by row: longitude's sine and cosine are apart, so that
  // turning left and right is one rotation of them.
  static sphere() {
    const corners = [];
    for (let row = 0; row <= LookAround.rows; row++) {
      const latitude = Math.PI * (0.5 - row / LookAround.rows);
      for (let column = 0; column <= LookAround.columns; column++) {
        const longitude = 2 * Math.PI * (column / LookAround.columns - 0.5);
        corners.push({ longitude, up: Math.sin(latitude), out: Math.cos(latitude) });
      }
    }
    return corners;
  }

  ahead() {
    [this.yaw, this.pitch, this.field] = [0, 0, (LookAround.limits.first * Math.PI) / 180];
  }

  // Radians to the right and up.
  turn(right, up) {
    this.yaw = (this.yaw + right) % (2 * Math.PI);
    this.pitch = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, this.pitch + up));
    this.change();
  }

  zoom(factor) {
    const [least, most] = [LookAround.limits.least, LookAround.limits.most].map((degrees) => (degrees * Math.PI) / 180);
    this.field = Math.max(least, Math.min(most, this.field * factor));
    this.change();
  }

  change() {
    if (this.isAsked) return;
    this.isAsked = true;
    requestAnimationFrame(() => {
      this.isAsked = false;
      for (const view of this.views) view.draw();
    });
  }

  // Corners on a canvas of this size; those behind the viewer have no place.
  project(width, height) {
    const focal = width / 2 / Math.tan(this.field / 2);
    const [sinPitch, cosPitch] = [Math.sin(this.pitch), Math.cos(this.pitch)];
    return this.corners.map(({ longitude, up, out }) => {
      const right = out * Math.sin(longitude - this.yaw);
      const ahead = out * Math.cos(longitude - this.yaw);
      const depth = ahead * cosPitch + up * sinPitch;
      if (depth < 0.05) return null;
      const above = up * cosPitch - ahead * sinPitch;
      return [width / 2 + (focal * right) / depth, height / 2 - (focal * above) / depth];
    });
  }
}

// One figure: two halves of one image, the line between them, and what hands do to it.
class SphereView {
  constructor(figure, shared) {
    Object.assign(this, { figure, shared, isSeen: false, hands: new Map() });
    this.stage = figure.querySelector(".stage");
    this.image = figure.querySelector("img");
    this.slider = figure.querySelector("input.split");
    this.error = figure.querySelector("input.error-map");
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("aria-hidden", "true");
    this.second = document.createElement("canvas");
    this.stage.append(this.canvas);
    this.image.addEventListener("load", () => shared.change());
    for (const input of [this.slider, this.error]) input.addEventListener("input", () => shared.change());
    const on = (name, act, options) => this.stage.addEventListener(name, (event) => shared.isOn && act(event), options);
    on("pointerdown", (event) => this.take(event));
    on("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) on(name, (event) => this.hands.delete(event.pointerId));
    on("wheel", (event) => this.wheel(event), { passive: false });
    on("keydown", (event) => this.key(event));
  }

  take(event) {
    const box = this.stage.getBoundingClientRect();
    const line = box.left + (box.width * this.slider.value) / 100;
    const isOnLine = !this.error.checked && Math.abs(event.clientX - line) < 14;
    this.hands.set(event.pointerId, { x: event.clientX, y: event.clientY, isOnLine });
    this.stage.setPointerCapture(event.pointerId);
  }

  move(event) {
    const hand = this.hands.get(event.pointerId);
    if (!hand) return;
    const box = this.stage.getBoundingClientRect();
    const [x, y] = [event.clientX - hand.x, event.clientY - hand.y];
    const before = this.spread();
    [hand.x, hand.y] = [event.clientX, event.clientY];
    if (this.hands.size > 1) this.shared.zoom(before / Math.max(this.spread(), 1));
    if (hand.isOnLine) {
      this.slider.value = (100 * (event.clientX - box.left)) / box.width;
      this.slider.dispatchEvent(new Event("input"));
    } else {
      const scale = this.shared.field / box.width / this.hands.size;
      this.shared.turn(-x * scale, y * scale);
    }
  }

  // Distance between two hands.
  spread() {
    const [first, second] = this.hands.values();
    return second ? Math.hypot(first.x - second.x, first.y - second.y) : 1;
  }

  // Over an image that has the focus the wheel zooms; over others it moves the page.
  wheel(event) {
    if (document.activeElement !== this.stage && !event.ctrlKey) return;
    event.preventDefault();
    this.shared.zoom(Math.exp(Math.sign(event.deltaY) * 0.1));
  }

  key(event) {
    const step = this.shared.field / 10;
    const turns = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
    const zooms = { "+": 0.8, "=": 0.8, "-": 1.25 };
    if (turns[event.key]) this.shared.turn(...turns[event.key]);
    else if (zooms[event.key]) this.shared.zoom(zooms[event.key]);
    else return;
    event.preventDefault();
  }

  draw() {
    const isOn = this.shared.isOn;
    this.figure.classList.toggle("looks", isOn);
    this.stage.tabIndex = isOn ? 0 : -1;
    if (isOn) {
      this.stage.setAttribute("role", "application");
      this.stage.setAttribute("aria-label", this.stage.dataset.label);
    } else {
      this.stage.removeAttribute("role");
      this.stage.removeAttribute("aria-label");
    }
    if (!isOn || !this.isSeen || !this.image.complete || !this.image.naturalWidth) return;
    const scale = Math.min(devicePixelRatio || 1, 1.5);
    const [width, height] = [this.stage.clientWidth, this.stage.clientHeight].map((side) => Math.round(side * scale));
    for (const canvas of [this.canvas, this.second]) {
      if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    }
    const corners = this.shared.project(width, height);
    const truth = Number(this.figure.dataset.truth);
    const context = this.canvas.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.globalCompositeOperation = "source-over";
    if (this.error.checked) {
      this.sphere(context, corners, truth, [0, width]);
      const other = this.second.getContext("2d");
      this.sphere(other, corners, 0, [0, width]);
      context.setTransform(1, 0, 0, 1, 0, 0);
      context.globalCompositeOperation = "difference";
      context.drawImage(this.second, 0, 0);
    } else {
      const line = Math.round((width * this.slider.value) / 100);
      this.sphere(context, corners, 0, [0, line]);
      this.sphere(context, corners, truth, [line, width]);
    }
    this.stage.dataset.drawn = `${this.shared.yaw.toFixed(3)} ${this.shared.pitch.toFixed(3)} ${this.shared.field.toFixed(3)}`;
  }

  // The half of the image that begins at a column, between two columns of the canvas.
  sphere(context, corners, begin, [left, right]) {
    const [width, height] = [this.figure.dataset.width, this.figure.dataset.height].map(Number);
    const half = { begin, width, height };
    const [wide, high] = [width / LookAround.columns, height / LookAround.rows];
    const bottom = context.canvas.height;
    context.save();
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.beginPath();
    context.rect(left, 0, right - left, bottom);
    context.clip();
    for (let row = 0; row < LookAround.rows; row++) {
      for (let column = 0; column < LookAround.columns; column++) {
        const at = row * (LookAround.columns + 1) + column;
        const below = at + LookAround.columns + 1;
        const piece = [corners[at], corners[at + 1], corners[below], corners[below + 1]];
        if (piece.some((corner) => !corner)) continue;
        const [across, down] = [0, 1].map((axis) => piece.map((corner) => corner[axis]));
        if (Math.max(...across) < left || Math.min(...across) > right) continue;
        if (Math.max(...down) < 0 || Math.min(...down) > bottom) continue;
        const source = [begin + column * wide, row * high, wide, high];
        const [a, b, c, d] = piece;
        this.triangle(context, half, source, [a, b, c], a, [b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        const [x, y] = [[d[0] - c[0], d[1] - c[1]], [d[0] - b[0], d[1] - b[1]]];
        this.triangle(context, half, source, [d, c, b], [c[0] - y[0], c[1] - y[1]], x, y);
      }
    }
    context.restore();
  }

  // A triangle of a piece whose upper left corner is at `origin` and whose edges are `x` and `y`. It is
  // a little larger than it should be, so that no line shows between two.
  triangle(context, half, [left, top, wide, high], points, origin, x, y) {
    const middle = [0, 1].map((axis) => (points[0][axis] + points[1][axis] + points[2][axis]) / 3);
    context.save();
    context.beginPath();
    for (const point of points) {
      const [right, down] = [point[0] - middle[0], point[1] - middle[1]];
      const grown = 1 + 0.9 / (Math.hypot(right, down) || 1);
      context.lineTo(middle[0] + right * grown, middle[1] + down * grown);
    }
    context.clip();
    context.setTransform(x[0] / wide, x[1] / wide, y[0] / high, y[1] / high, origin[0], origin[1]);
    // A pixel more on each side, where the half has it, so that edges are smooth as well.
    const { begin, width, height } = half;
    const [x0, x1] = [Math.max(left - 1, begin), Math.min(left + wide + 1, begin + width)];
    const [y0, y1] = [Math.max(top - 1, 0), Math.min(top + high + 1, height)];
    context.drawImage(this.image, x0, y0, x1 - x0, y1 - y0, x0 - left, y0 - top, x1 - x0, y1 - y0);
    context.restore();
  }
}

const figures = [...document.querySelectorAll("figure.compare[data-sphere]")];
if (figures.length) new LookAround(figures);

// The mechanism, drawn as: reference + magnification * (simulated - reference), body by body.
"use strict";

const WIDTH = 620; // width of the drawing, in its own units
const MOST_HEIGHT = 520;
const LEAST_HEIGHT = 170;
const PAD = 46; // room for names and supports
const LEAST_POWER = 0;
const MOST_POWER = 15;
const VISIBLE = 0.12; // of the size: the largest difference after "Make visible", within a factor of 3.3
const NONE = -32768; // the integer that encodes a value that is not finite

// Decode integers of 16 bits with a scale for each entry of the last axis.
function scaled(packed) {
  const whole = unpacked(packed.numbers, "i2");
  const { shape, scale } = packed;
  const values = new Float64Array(whole.length);
  for (let i = 0; i < whole.length; i += 1) {
    values[i] = whole[i] === NONE ? NaN : whole[i] * scale[i % scale.length];
  }
  return { values, count: shape[1], width: shape[2] };
}

// The numbers of item number `item` at a pose, interpolated between two poses of the array.
function between(array, pose, item) {
  const { values, count, width } = array;
  const poses = values.length / (count * width);
  const first = Math.min(Math.floor(pose), poses - 1);
  const second = Math.min(first + 1, poses - 1);
  const share = pose - first;
  const found = [];
  for (let k = 0; k < width; k += 1) {
    const before = values[(first * count + item) * width + k];
    const after = values[(second * count + item) * width + k];
    found.push(share > 0 ? before + share * (after - before) : before);
  }
  return found;
}

// The convex hull of points [x, y, x, y, ..], corner by corner (monotone chain).
function hull(numbers) {
  const points = [];
  for (let i = 0; i < numbers.length; i += 2) {
    points.push([numbers[i], numbers[i + 1]]);
  }
  points.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const turns = ([a, b], [c, d], [e, f]) => (c - a) * (f - b) - (d - b) * (e - a);
  const half = (ordered) => {
    const chain = [];
    for (const point of ordered) {
      while (chain.length > 1 && turns(chain.at(-2), chain.at(-1), point) <= 0) {
        chain.pop();
      }
      chain.push(point);
    }
    return chain.slice(0, -1);
  };
  return [...half(points), ...half([...points].reverse())];
}

function overlap(one, other) {
  const across = one.first < other.last && other.first < one.last;
  return across && one.top < other.bottom && other.top < one.bottom;
}

class Mechanism {
  constructor(svg, motion, curves) {
    this.svg = svg;
    this.motion = motion;
    this.x = unpacked(motion.x, "f8");
    this.places = scaled(motion.places);
    this.away = {};
    for (const [solver, packed] of Object.entries(motion.away)) {
      this.away[solver] = scaled(packed);
    }
    this.lines = motion.lines.map((line) => ({
      ...line,
      points: scaled(line.points),
      away: Object.fromEntries(
        Object.entries(line.away).map(([solver, packed]) => [solver, scaled(packed)]),
      ),
    }));
    this.curves = curves; // shapes of rods in an equilibrium run, which are curves of the run
    this.measure();
    this.build();
  }

  // Whether the drawing has both a reference and a solver.
  has(solver) {
    return Boolean(this.away[solver] || this.curves?.solvers.has(solver));
  }

  // Every point of the reference at some poses, from which the scale of the drawing is found.
  *everyPoint() {
    const poses = this.x.length;
    const step = Math.max(1, Math.floor(poses / 40));
    for (let pose = 0; pose < poses; pose += step) {
      for (let k = 0; k < this.motion.bodies.length; k += 1) {
        const place = between(this.places, pose, k);
        for (const outline of this.motion.bodies[k].outlines) {
          yield* this.moved(outline, place);
        }
      }
      for (const spot of this.motion.spots) {
        const place = spot.body >= 0 ? between(this.places, pose, spot.body) : [0, 0, 0];
        if (spot.rod === undefined) {
          yield* this.moved([...spot.at, ...(spot.to && spot.kind === "guide" ? spot.to : [])], place);
        }
      }
      for (const coil of this.motion.coils ?? []) {
        for (const [k, body] of coil.body.entries()) {
          const place = body >= 0 ? between(this.places, pose, body) : [0, 0, 0];
          yield* this.moved(coil.at[k], place);
        }
      }
      for (const line of this.lines) {
        for (let k = 0; k < line.points.count; k += 1) {
          yield between(line.points, pose, k);
        }
      }
    }
    if (this.curves) {
      for (const rod of this.curves.rods) {
        yield* rod.reference;
      }
    }
  }

  measure() {
    let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
    for (const [x, y] of this.everyPoint()) {
      left = Math.min(left, x);
      right = Math.max(right, x);
      low = Math.min(low, y);
      high = Math.max(high, y);
    }
    if (!Number.isFinite(left + right + low + high)) {
      [left, right, low, high] = [-1, 1, -1, 1];
    }
    this.size = Math.max(right - left, high - low) || 1;
    const wide = Math.max(right - left, 0.02 * this.size);
    const tall = Math.max(high - low, 0.02 * this.size);
    this.scale = Math.min((WIDTH - 2 * PAD) / wide, (MOST_HEIGHT - 2 * PAD) / tall);
    this.height = Math.max(LEAST_HEIGHT, tall * this.scale + 2 * PAD);
    this.middle = [(left + right) / 2, (low + high) / 2];
  }

  across(x) {
    return WIDTH / 2 + (x - this.middle[0]) * this.scale;
  }

  down(y) {
    return this.height / 2 - (y - this.middle[1]) * this.scale;
  }

  // Points [x, y, x, y, ..] of a body at its place, one by one.
  *moved(points, [x, y, turn]) {
    const cos = Math.cos(turn);
    const sin = Math.sin(turn);
    for (let i = 0; i < points.length; i += 2) {
      const [a, b] = [points[i], points[i + 1]];
      yield [x + cos * a - sin * b, y + sin * a + cos * b];
    }
  }

  path(points, closed) {
    const steps = [];
    for (const [x, y] of points) {
      if (Number.isFinite(x + y)) {
        steps.push(`${this.across(x).toFixed(2)} ${this.down(y).toFixed(2)}`);
      }
    }
    return steps.length ? `M${steps.join("L")}${closed ? "z" : ""}` : "";
  }

  add(kind, attributes, parent = this.svg) {
    const element = document.createElementNS("http://www.w3.org/2000/svg", kind);
    for (const [name, value] of Object.entries(attributes)) {
      element.setAttribute(name, value);
    }
    parent.append(element);
    return element;
  }

  // Create all elements once; `draw` moves them.
  build() {
    this.svg.replaceChildren();
    this.svg.setAttribute("viewBox", `0 0 ${WIDTH} ${this.height.toFixed(0)}`);
    const layers = ["ground", "track", "pale", "drawn", "names"];
    this.layer = Object.fromEntries(
      layers.map((name) => [name, this.add("g", { class: `m-${name}` })]),
    );
    for (const outline of this.motion.ground) {
      const points = [...this.moved(outline, [0, 0, 0])];
      this.add("path", { d: this.path(points, true), class: "m-block" }, this.layer.ground);
    }
    this.pale = this.motion.bodies.map((body) => this.body(body, this.layer.pale));
    this.drawn = this.motion.bodies.map((body) => this.body(body, this.layer.drawn));
    this.rods = [];
    const rods = this.curves
      ? this.curves.rods
      : this.lines.filter((line) => line.spot === undefined);
    for (const rod of rods) {
      this.rods.push({
        rod,
        pale: this.add("path", { class: "m-rod" }, this.layer.pale),
        drawn: this.add("path", { class: rod.coil ? "m-spring" : "m-rod" }, this.layer.drawn),
        dot: this.curves ? this.add("circle", { r: 5, class: "m-dot" }, this.layer.drawn) : null,
      });
    }
    const order = { guide: 0, clamp: 1, slide: 2, pin: 3, ball: 4, hinge: 4 };
    this.spots = this.motion.spots
      .map((spot, number) => ({ spot, number }))
      .sort((a, b) => order[a.spot.kind] - order[b.spot.kind])
      .map((one) => ({ ...one, element: this.sign(one.spot) }));
    this.coils = (this.motion.coils ?? []).map((coil) => ({
      coil,
      element: this.add("path", { class: "m-spring" }, this.layer.drawn),
    }));
    this.name();
  }

  body(body, layer) {
    const group = this.add("g", {}, layer);
    if (body.outlines.length > 1) {
      const corners = hull(body.outlines.flat());
      const steps = corners.map(([x, y]) => `${x * this.scale} ${-y * this.scale}`);
      this.add("path", { d: `M${steps.join("L")}z`, class: "m-area" }, group);
    }
    for (const outline of body.outlines) {
      const closed = outline.length > 4;
      const steps = [];
      for (let i = 0; i < outline.length; i += 2) {
        steps.push(
          `${(outline[i] * this.scale).toFixed(2)} ${(-outline[i + 1] * this.scale).toFixed(2)}`,
        );
      }
      this.add("path", { d: `M${steps.join("L")}${closed ? "z" : ""}` }, group);
    }
    return group;
  }

  // The sign of a joint about the place (0, 0); `draw` moves it to the joint.
  sign(spot) {
    const ground = spot.kind === "guide" || spot.kind === "clamp";
    const group = this.add("g", {}, ground ? this.layer.ground : this.layer.drawn);
    if (spot.kind === "guide") {
      this.add("path", { class: "m-guide" }, group);
    } else if (spot.kind === "clamp") {
      const hatch = [-14, -7, 0, 7, 14].map((y) => `M0 ${y}l-8 6`).join("");
      this.add("path", { d: `M0 -18v36${hatch}`, class: "m-soft" }, group);
    } else {
      if (spot.ground && spot.kind !== "slide") {
        const hatch = [-16, -8, 0, 8, 16].map((x) => `M${x} 21l-5 6`).join("");
        this.add("path", { d: `M0 0l-12 21h24zM-20 21h40${hatch}`, class: "m-support" }, group);
      }
      if (spot.spring) {
        const turns = [];
        for (let i = 0; i <= 40; i += 1) {
          const [angle, radius] = [(i / 40) * 5 * Math.PI, 7 + i * 0.27];
          turns.push(
            `${(radius * Math.cos(angle)).toFixed(1)} ${(radius * Math.sin(angle)).toFixed(1)}`,
          );
        }
        this.add("path", { d: `M${turns.join("L")}`, class: "m-spring" }, group);
      }
      const filled = spot.driven ? "m-joint m-driven" : "m-joint";
      if (spot.kind === "slide") {
        this.add("rect", { x: -7, y: -7, width: 14, height: 14, class: filled }, group);
      } else {
        this.add("circle", { r: spot.kind === "pin" ? 4 : 5.5, class: filled }, group);
      }
    }
    return group;
  }

  // Names of bodies and loops, each once.
  name() {
    this.names = [];
    const taken = new Set();
    const many = this.motion.bodies.length + this.lines.length > 12;
    for (const [k, body] of this.motion.bodies.entries()) {
      if (!many && body.outlines.length && !taken.has(body.name)) {
        taken.add(body.name);
        this.names.push({ text: this.text(body.name), body: k, middle: this.middleOf(body) });
      }
    }
    for (const { spot } of this.spots) {
      if (spot.kind === "pin" && spot.body >= 0 && spot.name && !taken.has(spot.name) && !many) {
        taken.add(spot.name);
        this.names.push({ text: this.text(spot.name), body: spot.body, middle: spot.at, spot });
      }
    }
  }

  text(words) {
    const element = this.add("text", {}, this.layer.names);
    element.textContent = words;
    return element;
  }

  // The middle of the longest edge of a body.
  middleOf(body) {
    let [longest, middle] = [-1, [0, 0]];
    for (const outline of body.outlines) {
      for (let i = 0; i < outline.length; i += 2) {
        const j = (i + 2) % outline.length;
        const [dx, dy] = [outline[j] - outline[i], outline[j + 1] - outline[i + 1]];
        if (Math.hypot(dx, dy) > longest * 1.001) {
          longest = Math.hypot(dx, dy);
          middle = [outline[i] + dx / 2, outline[i + 1] + dy / 2];
        }
      }
    }
    return middle;
  }

  // The fractional number of the pose at a value of the run's parameter.
  poseAt(x) {
    const last = this.x.length - 1;
    if (last < 1 || this.curves) {
      return 0;
    }
    const near = nearest(this.x, x);
    const first = this.x[near] > x && near > 0 ? near - 1 : Math.min(near, last - 1);
    const share = (x - this.x[first]) / (this.x[first + 1] - this.x[first]);
    return Math.min(Math.max(first + share, 0), last);
  }

  // Whether there is a pose of the model at x: its motion may end before the run.
  reaches(x) {
    const last = this.x[this.x.length - 1];
    const span = Math.abs(last - this.x[0]) || 1;
    return Boolean(this.curves) || this.x.length < 2 || x <= last + 1e-6 * span;
  }

  // Reference + factor * (simulated - reference) of body k; null where a solver has no such pose.
  placeOf(k, pose, solver, factor) {
    const place = between(this.places, pose, k);
    const away = this.away[solver];
    if (!away || !factor) {
      return place;
    }
    const off = between(away, pose, k);
    const there = place.map((value, i) => value + factor * off[i]);
    return there.every(Number.isFinite) ? there : null;
  }

  // Draw the pose at x of a solver; false if the solver has no such pose.
  draw(x, sample, solver, factor) {
    const pose = this.poseAt(x);
    const compared = this.has(solver);
    let there = true;
    for (let k = 0; k < this.motion.bodies.length; k += 1) {
      this.put(this.pale[k], compared ? this.placeOf(k, pose, solver, 0) : null);
      const place = this.placeOf(k, pose, solver, factor);
      there = there && place !== null;
      this.put(this.drawn[k], place);
    }
    for (const one of this.rods) {
      this.drawRod(one, pose, sample, solver, factor, compared);
    }
    for (const { spot, element } of this.spots) {
      this.drawSpot(spot, element, pose, solver, factor);
    }
    for (const { coil, element } of this.coils) {
      const ends = coil.body.map((body, k) => {
        const place = body < 0 ? [0, 0, 0] : this.placeOf(body, pose, solver, factor);
        return [...this.moved(coil.at[k], place ?? [NaN, NaN, NaN])][0];
      });
      element.setAttribute("d", this.zigzag(...ends));
    }
    this.drawNames(pose, solver, factor);
    return there;
  }

  // Draw the names beside bodies and loops; a name that would cover another is left out.  Their
  // sizes are those of the font that the browser draws them with, measured all at once, since a
  // measurement after a change lays out the page again.
  drawNames(pose, solver, factor) {
    const sizes = this.names.map(({ text }) => text.getBBox());
    const shown = [];
    for (const [k, { text, body, middle, spot }] of this.names.entries()) {
      const { width, height } = sizes[k];
      const rise = Number(text.getAttribute("y")) - sizes[k].y; // of the box above the base line
      const place = this.placeOf(body, pose, solver, factor) ?? [NaN, NaN, NaN];
      const [[across, up]] = [...this.moved(middle, place)];
      if (!Number.isFinite(across + up)) {
        continue;
      }
      const left = this.across(across) > WIDTH - width - 20;
      const x = this.across(across) + (left ? -10 : 10);
      const y = this.down(up) + (spot ? -8 : 18);
      const [first, top] = [left ? x - width : x, y - rise];
      const box = { first, last: first + width, top, bottom: top + height };
      const covered = shown.some((one) => overlap(one, box));
      text.style.visibility = covered ? "hidden" : "";
      text.setAttribute("text-anchor", left ? "end" : "start");
      text.setAttribute("x", x.toFixed(1));
      text.setAttribute("y", y.toFixed(1));
      if (!covered) {
        shown.push(box);
      }
    }
  }

  // The drawing of a spring from one point to another.
  zigzag([ax, ay], [bx, by]) {
    const [left, top] = [this.across(ax), this.down(ay)];
    const [dx, dy] = [this.across(bx) - left, this.down(by) - top];
    const length = Math.hypot(dx, dy) || 1;
    const width = Math.min(7, length / 4) / length;
    const steps = [];
    for (let i = -2; i < 12; i += 1) {
      const tooth = i >= 0 && i < 10;
      const share = tooth ? 0.15 + 0.07 * (i + 0.5) : [0, 0.15, 0.85, 1][i < 0 ? i + 2 : i - 8];
      const side = tooth ? width * (i % 2 ? -1 : 1) : 0;
      const [x, y] = [left + share * dx - side * dy, top + share * dy + side * dx];
      steps.push(`${x.toFixed(2)} ${y.toFixed(2)}`);
    }
    return Number.isFinite(left + top + dx + dy) ? `M${steps.join("L")}` : "";
  }

  put(element, place) {
    element.style.display = place ? "" : "none";
    if (place) {
      const turn = ((-place[2] * 180) / Math.PI).toFixed(4);
      const [across, down] = [this.across(place[0]).toFixed(3), this.down(place[1]).toFixed(3)];
      element.setAttribute("transform", `translate(${across} ${down}) rotate(${turn})`);
    }
  }

  drawRod({ rod, pale, drawn, dot }, pose, sample, solver, factor, compared) {
    const [reference, found] = [[], []];
    if (this.curves) {
      const off = rod.differences[solver];
      rod.reference.forEach(([x, y], i) => {
        reference.push([x, y]);
        found.push(off && i < off[0].length ? [x + factor * off[0][i], y + factor * off[1][i]] : [NaN, NaN]);
      });
      const here = found[sample] ?? reference[sample];
      dot.setAttribute("cx", this.across(here[0]));
      dot.setAttribute("cy", this.down(here[1]));
    } else {
      for (let k = 0; k < rod.points.count; k += 1) {
        const [x, y] = between(rod.points, pose, k);
        const [dx, dy] = rod.away[solver] ? between(rod.away[solver], pose, k) : [0, 0];
        reference.push([x, y]);
        found.push(factor ? [x + factor * dx, y + factor * dy] : [x, y]);
      }
    }
    pale.setAttribute("d", compared ? this.path(reference, false) : "");
    drawn.setAttribute("d", this.path(found, false));
  }

  drawSpot(spot, element, pose, solver, factor) {
    let at = null;
    let turn = 0;
    if (spot.rod !== undefined) {
      const line = this.lines.find((one) => one.spot === spot.rod);
      const [x, y] = between(line.points, pose, 0);
      const [dx, dy] = line.away[solver] ? between(line.away[solver], pose, 0) : [0, 0];
      at = [x + factor * dx, y + factor * dy];
    } else {
      const place = spot.body < 0 ? [0, 0, 0] : this.placeOf(spot.body, pose, solver, factor);
      if (place) {
        at = [...this.moved(spot.at, place)][0];
        turn = place[2];
        if (spot.kind === "guide") {
          const line = [...this.moved([...spot.at, ...spot.to], place)];
          element.firstChild.setAttribute("d", this.path(line, false));
          return;
        }
        if (spot.kind === "clamp") {
          const ahead = [...this.moved(spot.to, place)][0];
          turn = Math.atan2(ahead[1] - at[1], ahead[0] - at[0]);
        }
      }
    }
    element.style.display = at && Number.isFinite(at[0] + at[1]) ? "" : "none";
    if (at && spot.kind !== "guide") {
      const angle = ["slide", "clamp"].includes(spot.kind) ? ((-turn * 180) / Math.PI).toFixed(2) : 0;
      const place = `${this.across(at[0]).toFixed(3)} ${this.down(at[1]).toFixed(3)}`;
      element.setAttribute("transform", `translate(${place}) rotate(${angle})`);
      const limit = this.motion.limits[spot.name]?.includes(Math.round(pose));
      element.classList.toggle("m-limit", Boolean(limit));
    }
  }

  // Joints that are at a joint limit at x.
  limitsAt(x) {
    const pose = Math.round(this.poseAt(x));
    const limits = Object.entries(this.motion.limits);
    return limits.filter(([, poses]) => poses.includes(pose)).map(([name]) => name);
  }

  // The magnification, as a power of ten, at which the largest difference of a solver is visible.
  power(solver) {
    let largest = 0;
    const parts = [this.away[solver], ...this.lines.map((line) => line.away[solver])];
    for (const away of parts.filter(Boolean)) {
      for (let i = 0; i < away.values.length; i += 1) {
        const turn = away.width === 3 && i % 3 === 2;
        const off = Math.abs(away.values[i]) * (turn ? 0.5 * this.size : 1);
        largest = Math.max(largest, Number.isFinite(off) ? off : 0);
      }
    }
    for (const rod of this.curves?.rods ?? []) {
      for (const part of rod.differences[solver] ?? []) {
        largest = part.reduce((most, off) => Math.max(most, Math.abs(off) || 0), largest);
      }
    }
    if (!largest) {
      return LEAST_POWER;
    }
    const power = Math.floor(Math.log10((VISIBLE * 3 * this.size) / largest));
    return Math.min(Math.max(power, LEAST_POWER), MOST_POWER);
  }
}

// One channel of a run: the curves above, their differences to the reference below.
"use strict";

const BAND_SHARE = 12; // largest ratio of what is allowed to the differences at which its band is shown
const LEAST = 1e-16; // end of a linear axis where all differences are zero
const SMALLEST = 0.03; // share of the differences that may lie below a logarithmic axis
const NAMED_SOLVERS = 2; // solvers that the words at a band name; of more, their number
const MARKERS = 9; // number of markers on a curve, which distinguish it without its colour

// Draw the marker of a solver about a place of a canvas, with lines of a width.
function drawMarker(ctx, path, x, y, scale, width) {
  const outline = new Path2D(path);
  ctx.save();
  ctx.translate(x, y);
  ctx.scale(scale, scale);
  ctx.lineWidth = width / scale;
  ctx.fill(outline);
  ctx.stroke(outline);
  ctx.restore();
}

// Two strokes that cross at a place.
function cross(ctx, x, y, r) {
  ctx.moveTo(x - r, y - r);
  ctx.lineTo(x + r, y + r);
  ctx.moveTo(x + r, y - r);
  ctx.lineTo(x - r, y + r);
}

// Powers of ten between two, at most about six of them.
function decades(plot, axis, low, high) {
  const first = Math.ceil(Math.log10(low) - 1e-6);
  const last = Math.floor(Math.log10(high) + 1e-6);
  const step = Math.max(1, Math.ceil((last - first) / 5));
  const found = [];
  for (let power = last; power >= first; power -= step) {
    found.unshift(10 ** power);
  }
  return found;
}

function plainLabels(plot, values) {
  return values.map((value) => {
    if (value === null) {
      return "";
    }
    const size = Math.abs(value);
    const short = size >= 1e-3 && size < 1e5;
    return short ? String(Number(value.toPrecision(6))).replace("-", MINUS) : worded(value, 2);
  });
}

// Paths for uPlot of a curve that is open at its jumps; without jumps uPlot's own paths.
function openAt(xs, jumps) {
  if (!jumps.length) {
    return {};
  }
  const open = new Set(jumps);
  return {
    paths: (plot, series, first, last) => {
      const stroke = new Path2D();
      let begun = false;
      for (let k = first; k <= last; k += 1) {
        const value = plot.data[series][k];
        if (value === null || value === undefined) {
          begun = false;
          continue;
        }
        const place = [plot.valToPos(xs[k], "x", true), plot.valToPos(value, "y", true)];
        if (begun) {
          stroke.lineTo(...place);
        } else {
          stroke.moveTo(...place);
        }
        begun = !open.has(k);
      }
      return { stroke, fill: null, clip: null, band: null, gaps: null, flags: 1 };
    },
  };
}

// The jumps of a solver's difference: those of the solver and those of the reference.
const apartAt = (solver, channel) => [...new Set([...solver.jumps, ...channel.jumps])];

class CurvePair {
  // `seen` has the callbacks point(k), zoomed([low, high] or null) and left().
  constructor(above, below, seen) {
    this.above = above;
    this.below = below;
    this.seen = seen;
    this.plots = [];
    this.passing = false; // true while a zoom is applied to the other plot
    this.pointing = false;
    this.sync = uPlot.sync("pair");
  }

  // Build both plots anew.  `view` has run, channel, solvers, mode, zoom, sample.
  show(view) {
    this.view = view;
    for (const plot of this.plots) {
      plot.destroy();
    }
    this.ink = variable("--ink");
    this.soft = variable("--soft");
    this.hair = variable("--hair");
    this.letters = variable("--sans");
    const narrow = this.above.clientWidth < 520;
    const { run, channel, solvers } = view;
    const line = (solver, jumps) => ({
      label: solver.label,
      stroke: variable(`--${solver.css}`),
      width: 1.7,
      dash: solver.dash,
      points: { show: false },
      ...openAt(run.xs, jumps),
    });
    const reference = {
      stroke: variable("--pale"),
      width: 6,
      points: { show: false },
      ...openAt(run.xs, channel.jumps),
    };
    const known = (value) => (Number.isFinite(value) ? value * channel.read_factor : null);
    const curves = [run.xs, channel.curve.map(known)];
    for (const solver of solvers) {
      curves.push(this.found(solver, channel));
    }
    this.columns = [run.xs, ...solvers.map((solver) => this.difference(solver))];
    const limits = this.columns.length > 1 ? this.range() : [-1, 1];
    const hooks = (series) => ({
      ready: [(plot) => this.line(plot)],
      setScale: [(plot, key) => key === "x" && this.pass(plot)],
      setCursor: [(plot) => this.point(plot)],
      draw: [
        (plot) => this.plots.includes(plot) && this.markers(plot, series),
        (plot) => this.plots.includes(plot) && this.ends(plot, series),
      ],
    }); // a removed plot may still draw once, after the view has changed
    const whole = hooks(2);
    whole.draw.unshift((plot) => this.plots.includes(plot) && this.jumps(plot));
    const found = solvers.map((solver) => line(solver, solver.jumps));
    const top = new uPlot(
      this.options(narrow ? 190 : 238, [{}, reference, ...found], {}, whole),
      curves,
      this.above,
    );
    const scale =
      view.mode === "log" ? { distr: 3, range: () => limits } : { range: () => limits };
    const more = hooks(1);
    more.drawClear = [(plot) => this.plots.includes(plot) && this.bands(plot)];
    more.draw.push((plot) => this.plots.includes(plot) && this.rings(plot));
    const apart = solvers.map((solver) => line(solver, apartAt(solver, channel)));
    const bottom = new uPlot(
      this.options(narrow ? 170 : 214, [{}, ...apart], scale, more),
      this.columns,
      this.below,
    );
    this.plots = [top, bottom];
    if (view.zoom) {
      this.zoom(view.zoom);
    }
    this.scrub(view.sample);
  }

  // The curve of a solver in the displayed unit; null where it has none.
  found(solver, channel) {
    const { difference, shift } = solver;
    return channel.curve.map((value, i) => {
      const found = value + (shift ? shift[i] : 0) + (i < difference.length ? difference[i] : NaN);
      return Number.isFinite(found) ? found * channel.read_factor : null;
    });
  }

  // The difference of a solver for the axis of the mode; null where it cannot be drawn.
  difference(solver) {
    const { run, channel, mode } = this.view;
    return run.xs.map((_, i) => {
      const off = i < solver.difference.length ? solver.difference[i] * channel.factor : NaN;
      if (!Number.isFinite(off)) {
        return null;
      }
      if (mode === "log") {
        return off ? Math.abs(off) : null;
      }
      if (mode === "tol") {
        return solver.allowed ? off / solver.allowed : null;
      }
      return off;
    });
  }

  // The ends of the lower axis.
  range() {
    const { solvers, mode } = this.view;
    const sizes = this.columns
      .slice(1)
      .flat()
      .filter((value) => value)
      .map(Math.abs)
      .sort((a, b) => a - b);
    let most = sizes.at(-1) ?? 0;
    const least = sizes[Math.floor(SMALLEST * sizes.length)]; // a zero crossing needs no decades
    const allowed = Math.max(0, ...solvers.map((solver) => solver.allowed ?? 0));
    if (mode === "log") {
      const high = Math.max(most, allowed) || 1;
      const low = Math.min(least ?? high, high / 10);
      return [10 ** Math.floor(Math.log10(low)), 10 ** Math.ceil(Math.log10(high * 1.0001))];
    }
    const band = mode === "tol" ? 1 : allowed;
    most = most || LEAST;
    if (band && band < most * BAND_SHARE) {
      most = Math.max(most, 1.12 * band);
    }
    return [-1.08 * most, 1.08 * most];
  }

  options(height, series, scale, hooks) {
    const { run } = this.view;
    const width = this.above.clientWidth;
    const grid = { stroke: this.hair, width: 1 };
    const font = `12px ${this.letters}`;
    const log = scale.distr === 3;
    const unit = run.unit === "deg" ? "°" : ` ${run.unit}`;
    return {
      width,
      height,
      legend: { show: false },
      cursor: {
        sync: { key: "pair", setSeries: false },
        drag: { x: true, y: false },
        points: { size: 7 },
      },
      scales: { x: { time: false }, y: scale },
      axes: [
        {
          stroke: this.soft,
          grid,
          ticks: grid,
          font,
          size: 28,
          values: (plot, values) => values.map((value) => Number(value.toFixed(3)) + unit),
        },
        {
          stroke: this.soft,
          grid,
          ticks: grid,
          font,
          size: width < 520 ? 62 : 78,
          ...(log && {
            splits: decades,
            filter: (plot, values) => values,
          }),
          values: log ? (plot, values) => values.map((value) => worded(value, 1)) : plainLabels,
        },
      ],
      series,
      hooks,
    };
  }

  // Connect the line of the sample and the callbacks to the pointer in both plots.
  line(plot) {
    const line = document.createElement("div");
    line.className = "scrub-line";
    plot.over.append(line);
    plot.scrubLine = line;
    plot.over.addEventListener("mouseenter", () => {
      this.pointing = true;
    });
    plot.over.addEventListener("mouseleave", () => {
      this.pointing = false;
      this.seen.left();
    });
    plot.over.addEventListener("pointerdown", (event) => {
      if (event.pointerType !== "mouse") {
        this.seen.point(plot.posToIdx(event.offsetX)); // a finger has no position before it touches
      }
    });
  }

  point(plot) {
    if (this.pointing && plot.cursor.left >= 0 && plot.cursor.idx !== null) {
      this.seen.point(plot.cursor.idx);
    }
  }

  // Apply the zoom of one plot to the other.
  pass(plot) {
    if (this.passing || this.plots.length < 2 || !this.plots.includes(plot)) {
      return;
    }
    const { min, max } = plot.scales.x;
    const { xs } = this.view.run;
    const [first, last] = [xs[0], xs[xs.length - 1]];
    const whole = min <= first + 1e-9 && max >= last - 1e-9;
    this.passing = true;
    this.plots.find((other) => other !== plot).setScale("x", { min, max });
    this.passing = false;
    this.view.zoom = whole ? null : [min, max];
    this.seen.zoomed(this.view.zoom);
    this.scrub(this.view.sample);
  }

  zoom([min, max]) {
    this.passing = true;
    for (const plot of this.plots) {
      plot.setScale("x", { min, max });
    }
    this.passing = false;
  }

  // Move the line to a sample.
  scrub(sample) {
    if (!this.view) {
      return;
    }
    this.view.sample = sample;
    for (const plot of this.plots) {
      if (plot.scrubLine) {
        const x = plot.valToPos(this.view.run.xs[sample], "x");
        const inside = x >= 0 && x <= plot.over.clientWidth;
        plot.scrubLine.style.display = inside ? "" : "none";
        plot.scrubLine.style.transform = `translateX(${x.toFixed(1)}px)`;
      }
    }
  }

  // Draw what is allowed as a band behind the differences, with its solvers and its number.
  bands(plot) {
    const { solvers, mode } = this.view;
    const ctx = plot.ctx;
    const { left, top, width, height } = plot.bbox;
    const ratio = devicePixelRatio;
    const used = [];
    const shown = new Map();
    for (const solver of solvers.filter((one) => one.allowed)) {
      const allowed = mode === "tol" ? 1 : solver.allowed;
      shown.set(allowed, [...(shown.get(allowed) ?? []), solver]);
    }
    for (const [allowed, own] of shown) {
      const upper = plot.valToPos(allowed, "y", true);
      const lower = mode === "log" ? top + height : plot.valToPos(-allowed, "y", true);
      const beyond = upper < top - 1 && mode !== "log";
      const colour = own.length === 1 ? variable(`--${own[0].css}`) : this.soft;
      const clipped = [Math.max(upper, top), Math.min(lower, top + height)];
      ctx.save();
      ctx.beginPath();
      ctx.rect(left, top, width, height);
      ctx.clip();
      ctx.fillStyle = colour;
      ctx.globalAlpha = 0.09;
      ctx.fillRect(left, clipped[0], width, clipped[1] - clipped[0]);
      if (!beyond) {
        ctx.globalAlpha = 0.75;
        ctx.strokeStyle = colour;
        ctx.lineWidth = ratio;
        ctx.setLineDash([5 * ratio, 4 * ratio]);
        ctx.beginPath();
        for (const y of mode === "log" ? [upper] : [upper, lower]) {
          ctx.moveTo(left, y);
          ctx.lineTo(left + width, y);
        }
        ctx.stroke();
        ctx.setLineDash([]);
      }
      const more = own.length > NAMED_SOLVERS ? ` and ${own.length - NAMED_SOLVERS} more` : "";
      const names = own.slice(0, NAMED_SOLVERS).map((one) => one.label);
      let words = `${names.join(", ")}${more}: allowed ±${worded(allowed)}`;
      words = mode === "tol" ? "allowed" : words;
      words += beyond ? ", beyond this axis" : "";
      let y = beyond ? top + 4 * ratio : Math.max(top + 3 * ratio, upper + 4 * ratio);
      while (used.some((other) => Math.abs(other - y) < 14 * ratio)) {
        y += 15 * ratio;
      }
      used.push(y);
      if (y + 15 * ratio > top + height) {
        ctx.restore(); // without room for words: they stand below the curves
        continue;
      }
      ctx.font = `${12 * ratio}px ${this.letters}`;
      ctx.textAlign = "right";
      ctx.textBaseline = "top";
      const wide = ctx.measureText(words).width;
      ctx.globalAlpha = 0.85;
      ctx.fillStyle = variable("--card");
      ctx.fillRect(left + width - wide - 10 * ratio, y - 2 * ratio, wide + 8 * ratio, 17 * ratio);
      ctx.globalAlpha = 1;
      ctx.fillStyle = colour;
      ctx.fillText(words, left + width - 6 * ratio, y);
      ctx.restore();
    }
  }

  // Draw at a place of a plot if the place is inside it.
  mark(plot, x, y, paint) {
    const { left, top, width, height } = plot.bbox;
    const across = plot.valToPos(x, "x", true);
    const down = plot.valToPos(y, "y", true);
    if (across >= left - 1 && across <= left + width + 1 && down >= top && down <= top + height) {
      plot.ctx.beginPath();
      paint(plot.ctx, across, down);
    }
  }

  // Draw a dotted vertical line at a jump of the reference, which has no values in between.
  jumps(plot) {
    const { run, channel } = this.view;
    const ctx = plot.ctx;
    const ratio = devicePixelRatio;
    const { left, top, width, height } = plot.bbox;
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, top, width, height);
    ctx.clip();
    ctx.strokeStyle = this.soft;
    ctx.lineWidth = ratio;
    ctx.setLineDash([2 * ratio, 4 * ratio]);
    for (const k of channel.jumps) {
      const sides = [k, k + 1].map((at) => plot.valToPos(run.xs[at], "x", true));
      const across = Math.round((sides[0] + sides[1]) / 2) + 0.5;
      ctx.beginPath();
      ctx.moveTo(across, plot.valToPos(plot.data[1][k], "y", true));
      ctx.lineTo(across, plot.valToPos(plot.data[1][k + 1], "y", true));
      ctx.stroke();
    }
    ctx.restore();
  }

  // Draw a few staggered markers on each curve, which distinguish solvers without colour.
  markers(plot, first) {
    const { run, solvers } = this.view;
    const { min, max } = plot.scales.x;
    const low = nearest(run.xs, min);
    const high = nearest(run.xs, max);
    const step = Math.max(1, Math.floor((high - low) / MARKERS));
    const ctx = plot.ctx;
    const ratio = devicePixelRatio;
    solvers.forEach((solver, number) => {
      const values = plot.data[first + number];
      ctx.save();
      ctx.setLineDash([]);
      ctx.strokeStyle = variable(`--${solver.css}`);
      ctx.fillStyle = variable("--card");
      const start = low + Math.floor(((number + 0.5) * step) / solvers.length);
      for (let i = start; i <= high; i += step) {
        if (values[i] !== null && values[i] !== undefined) {
          this.mark(plot, run.xs[i], values[i], (_, x, y) => {
            drawMarker(ctx, solver.marker, x, y, 0.85 * ratio, 1.4 * ratio);
          });
        }
      }
      ctx.restore();
    });
  }

  // Draw a cross and a word where the curve of a solver ends before the run.
  ends(plot, first) {
    const { run, solvers } = this.view;
    const { left, top, width, height } = plot.bbox;
    const ctx = plot.ctx;
    const ratio = devicePixelRatio;
    const ending = solvers.map((solver, number) => ({ solver, number })).filter(({ solver }) => solver.end);
    ending.forEach(({ solver, number }, place) => {
      const values = plot.data[first + number];
      const k = values.findLastIndex((value) => value !== null && value !== undefined);
      if (k < 0) {
        return;
      }
      const across = plot.valToPos(run.xs[k], "x", true);
      if (across < left - 1 || across > left + width + 1) {
        return;
      }
      ctx.save();
      ctx.strokeStyle = variable(`--${solver.css}`);
      ctx.fillStyle = ctx.strokeStyle;
      ctx.lineWidth = ratio;
      ctx.setLineDash([2 * ratio, 3 * ratio]);
      ctx.beginPath();
      ctx.moveTo(across, top);
      ctx.lineTo(across, top + height);
      ctx.stroke();
      ctx.setLineDash([]);
      ctx.lineWidth = 2 * ratio;
      this.mark(plot, run.xs[k], values[k], (_, x, y) => {
        cross(ctx, x, y, 5 * ratio);
        ctx.stroke();
      });
      const onLeft = across < left + width / 2;
      ctx.font = `${12 * ratio}px ${this.letters}`;
      ctx.textAlign = onLeft ? "left" : "right";
      ctx.textBaseline = "bottom";
      const y = top + height - (4 + 15 * place) * ratio;
      ctx.fillText(`${solver.label} ${solver.end}`, across + (onLeft ? 6 : -6) * ratio, y);
      ctx.restore();
    });
  }

  // Draw a ring at the largest error of a comparison.
  rings(plot) {
    const { run, solvers } = this.view;
    const ctx = plot.ctx;
    const ratio = devicePixelRatio;
    solvers.forEach((solver, number) => {
      if (solver.at === null || solver.at === undefined) {
        return;
      }
      const k = nearest(run.x, solver.at);
      const value = plot.data[number + 1][k];
      if (value === null) {
        return;
      }
      ctx.save();
      ctx.setLineDash([]);
      ctx.strokeStyle = variable(`--${solver.css}`);
      ctx.lineWidth = 1.8 * ratio;
      this.mark(plot, run.xs[k], value, (_, x, y) => {
        ctx.arc(x, y, 6.5 * ratio, 0, 2 * Math.PI);
        ctx.stroke();
      });
      ctx.restore();
    });
  }
}

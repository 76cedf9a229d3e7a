// The page of a case: its state, which the address stores, and the functions that show the state.
"use strict";

const data = JSON.parse(find("#data").textContent);
const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
const MODES = ["lin", "log", "tol"];
const openedAt = location.hash; // the requested address, before the state overwrites it
const FRAMES = 60; // [1/s] poses of the engine that are shown
const SECONDS = 6; // [s] least playing time of a whole run

const state = {
  run: "", // kind of the run
  solver: "", // whose mechanism is drawn
  channel: "",
  sample: 0, // number of the drawn sample
  radians: false, // whether angles are shown in radians
  mode: "lin", // of the axis of differences, one of MODES
  shown: null, // set of solvers whose curves are drawn
  zoom: null, // [low, high] in the displayed unit
  power: 0, // magnification of the differences, as a power of ten
};

// ---- the data, decoded once

function decode() {
  for (const [kind, run] of Object.entries(data.runs)) {
    run.kind = kind;
    run.whole = Boolean(run.x);
    if (!run.whole) {
      continue;
    }
    run.x = Array.from(unpacked(run.x, "f8"));
    run.xs = run.x.map((x) => x * run.scale);
    for (const channel of Object.values(run.channels)) {
      channel.curve = Array.from(unpacked(channel.curve, "f8"));
      channel.jumps ??= []; // indices of the samples before jumps
    }
    for (const solver of Object.values(run.solvers)) {
      for (const curves of [solver.differences ?? {}, solver.shifts ?? {}]) {
        for (const name of Object.keys(curves)) {
          curves[name] = unpacked(curves[name], "f4");
        }
      }
    }
  }
  Object.keys(data.solvers).forEach((name, number) => {
    data.solvers[name].css = `s${number}`;
  });
}

// Show all angles in degrees or in radians: each channel has one unit in curves, differences, lists
// and sentences, and so has a sweep over an angle.
function showAngles(radians) {
  state.radians = radians;
  for (const run of Object.values(data.runs)) {
    if (run.whole) {
      run.own ??= { unit: run.unit, scale: run.scale };
      const turned = radians && run.own.unit === "deg";
      Object.assign(run, turned ? { unit: "rad", scale: 1 } : run.own);
      run.xs = run.x.map((x) => x * run.scale);
    }
    for (const [name, channel] of Object.entries(run.channels)) {
      channel.own ??= { ...channel };
      const { read, read_factor: degrees, factor, range } = channel.own;
      const turned = radians && read.startsWith("deg");
      const unit = turned ? read.replace("deg", "rad") : read;
      const shown = turned ? 1 : degrees;
      const more = shown / factor; // from the unit of the sidecar to the one that is shown
      Object.assign(channel, { unit, read: unit, factor: shown, read_factor: shown, range: range * more });
      for (const solver of Object.values(run.solvers)) {
        const c = solver.comparisons[name];
        if (c) {
          c.own ??= { error: c.error, allowed: c.allowed };
          const of = (value) => (value === null ? null : value * more);
          Object.assign(c, { error: of(c.own.error), allowed: of(c.own.allowed) });
        }
      }
    }
  }
}

// Whether the page has an angle at all, so that there is something to choose.
const hasAngles = () =>
  runs().some(
    (run) =>
      (run.own ?? run).unit === "deg" ||
      Object.values(run.channels).some((channel) => (channel.own ?? channel).read.startsWith("deg")),
  );

function chooseAngles(radians) {
  const run = current();
  const before = run.scale;
  showAngles(radians);
  if (state.zoom) {
    state.zoom = state.zoom.map((value) => (value * run.scale) / before);
  }
  drawAll();
}

const runs = () => Object.values(data.runs).filter((run) => run.whole);
const current = () => data.runs[state.run];
const comparison = (solver, channel = state.channel) =>
  current().solvers[solver]?.comparisons[channel];
// Outcomes of curves within what is allowed, in a run that tells nothing of the model.
const EMPTY = ["nothing moved", "other step"];
const judged = (c) => c && ["agrees", "differs", "undecided", ...EMPTY].includes(c.outcome);
// Whether a solver failed and has no curves.
const gone = (run, name) => Boolean(run.failed[name]) && !run.solvers[name]?.differences;
const solversOf = (run) => Object.keys(run.solvers).filter((name) => run.solvers[name].differences);

// The channels of a run, largest error over what is allowed first, then those that are not checked.
function ordered(run) {
  const rank = (name) => {
    const own = Object.values(run.solvers).map((solver) => solver.comparisons[name]);
    const ratios = own.filter(judged).map((c) => c.ratio ?? Infinity);
    return ratios.length ? Math.max(...ratios) : -1;
  };
  return Object.keys(run.channels)
    .map((name) => ({ name, ratio: rank(name) }))
    .sort((a, b) => b.ratio - a.ratio);
}

// Format a value of the run's parameter, given in SI, in the displayed unit.
function placed(run, x, digits = 4) {
  return `${worded(x * run.scale, digits)}${run.unit === "deg" ? "°" : ` ${run.unit}`}`;
}

const atSample = (sample) => placed(current(), current().x[sample]);

// Where the curves of a solver end.
const endOf = (run, name) => `${worded(run.solvers[name].end * run.scale, 4)} ${run.unit}`;

const powerWords = (power) => `×${power > 3 ? `1e${power}` : 10 ** power}`;

// ---- the mechanism

const mechanisms = {};

function mechanism() {
  const motion = data.motions[state.run];
  if (!motion || !find("#mechanism")) {
    return null;
  }
  if (!mechanisms[state.run]) {
    mechanisms[state.run] = new Mechanism(find("#mechanism"), motion, rodsAtRest(motion));
    mechanisms.built = state.run;
  }
  if (mechanisms.built !== state.run) {
    mechanisms[state.run].build();
    mechanisms.built = state.run;
  }
  return mechanisms[state.run];
}

// The rods of an equilibrium run, whose shapes are curves over their length; null in other runs.
function rodsAtRest(motion) {
  const run = current();
  const [across, up] = motion.axes;
  const names = Object.keys(run.channels)
    .filter((name) => name.endsWith(`.${across}`))
    .map((name) => name.slice(0, -across.length - 1))
    .filter((name) => run.channels[`${name}.${up}`]);
  if (run.kind !== "equilibrium" || !names.length) {
    return null;
  }
  const part = (name, axis) => run.channels[`${name}.${axis}`].curve;
  return {
    solvers: new Set(solversOf(run)),
    rods: names.map((name) => ({
      name,
      reference: part(name, across).map((x, i) => [x, part(name, up)[i]]),
      differences: Object.fromEntries(
        solversOf(run)
          .filter((solver) => run.solvers[solver].differences[`${name}.${up}`])
          .map((solver) => [
            solver,
            [across, up].map((axis) => run.solvers[solver].differences[`${name}.${axis}`]),
          ]),
      ),
    })),
  };
}

function drawMechanism() {
  const own = mechanism();
  const run = current();
  const label = data.solvers[state.solver]?.label ?? "";
  const scrub = find("#scrub");
  scrub.value = state.sample;
  scrub.setAttribute("aria-valuetext", atSample(state.sample));
  find("#position").textContent = atSample(state.sample);
  moveGapLine();
  if (!own) {
    return;
  }
  const x = run.x[state.sample];
  const there = own.draw(x, state.sample, state.solver, 10 ** state.power);
  find("#mechanism").setAttribute("class", `mechanism ${data.solvers[state.solver]?.css ?? ""}`);
  const compared = own.has(state.solver);
  const words = [];
  if (!own.reaches(x)) {
    words.push(`drawn up to ${worded(own.x[own.x.length - 1] * run.scale, 3)} ${run.unit} only`);
  } else if (!compared) {
    words.push(own.motion.along ? "to scale, without differences" : "no positions to compare");
  } else if (!there) {
    words.push(`${label} has no pose here`);
  } else {
    words.push(
      state.power ? `differences to the reference ${powerWords(state.power)}` : "to scale",
    );
  }
  const limits = own.limitsAt(x);
  if (limits.length) {
    words.push(`${limits.join(", ")} at the end of its range`);
  }
  find("#mechanism-title").textContent = `${run.label}, ${label}`;
  find("#mechanism-scale").textContent = words.join("; ");
  find("#magnification").value = state.power;
  find("#magnification-words").textContent = powerWords(state.power);
  find("#magnification").setAttribute("aria-valuetext", powerWords(state.power));
  find("#magnify").hidden = !compared;
  find("#ghost").textContent = ghostWords(own);
}

// Describe the pale mechanism.
function ghostWords(own) {
  const motion = own.motion;
  const run = current();
  const jumps = motion.jumps.map(
    (k) => `between ${placed(run, own.x[k - 1])} and ${placed(run, own.x[k])}`,
  );
  const jumped = jumps.length ? ` It jumps to another equilibrium ${formatList(jumps)}.` : "";
  const stopped =
    jumped + (motion.stopped ? ` Drawn as far as it goes: ${motion.stopped}.` : "");
  if (own.curves && own.has(state.solver)) {
    return "Pale: the rods of the reference. Lines: the engine's." + stopped;
  }
  if (motion.along) {
    return (
      `The mechanism moves in space and is seen along ${motion.along}, as MuJoCo moves it. ` +
      "Differences of curves are not drawn here." + stopped
    );
  }
  if (!own.has(state.solver)) {
    return (
      "The model as MuJoCo poses it at these values of its drives. This run compares no positions " +
      "of bodies, so there is no pale reference." + stopped
    );
  }
  const many = motion.used.length;
  const fit =
    motion.unfit > 1e-3
      ? ` They fit these curves to ${worded(motion.unfit)} of the size.`
      : "";
  return (
    `Pale: the bodies of the model where ${many} position curve${many > 1 ? "s" : ""} of the ` +
    `reference put${many > 1 ? "" : "s"} them. Lines: the same with the differences of the ` +
    `engine's curves.${fit}${stopped}`
  );
}

// ---- the distance below the mechanism, on the axis of the scrub bar

const GAP = { left: 56, height: 96, floor: 1e-17 };

// The curve below the mechanism: the distance of the worst point, or the worst position, or channel.
function gapOf(run) {
  const axes = data.motions[run.kind]?.axes ?? ["x", "y"];
  const has = (name) => solversOf(run).some((solver) => run.solvers[solver].differences[name]);
  const order = ordered(run).map((one) => one.name);
  for (const name of order) {
    const stem = name.slice(0, name.lastIndexOf("."));
    const parts = axes.map((axis) => `${stem}.${axis}`);
    if (name.includes(".") && parts.every((part) => run.channels[part]?.kind === "position" && has(part))) {
      return { parts, words: `Distance of ${stem} to its reference [m]` };
    }
  }
  const name = order.find((one) => run.channels[one].kind === "position" && has(one)) ?? order[0];
  return { parts: [name], words: `|difference| of ${name} [${run.channels[name].unit}]` };
}

function drawGap() {
  const svg = find("#gap");
  const run = current();
  const { parts, words } = gapOf(run);
  const width = Math.max(svg.clientWidth - GAP.left - 8, 60);
  const lines = [];
  let [low, high] = [Infinity, -Infinity];
  for (const solver of solversOf(run)) {
    const own = parts.map((part) => run.solvers[solver].differences[part]);
    if (own.some((part) => !part)) {
      continue;
    }
    const factor = parts.length > 1 ? 1 : run.channels[parts[0]].factor;
    const values = [...own[0]].map((_, i) => {
      const off = Math.hypot(...own.map((part) => part[i])) * factor;
      return Math.log10(Math.max(off, GAP.floor));
    });
    const known = values.filter(Number.isFinite).sort((a, b) => a - b);
    low = Math.min(low, known[Math.floor(known.length * 0.03)]);
    high = Math.max(high, known[known.length - 1]);
    const solvers = run.solvers[solver].jumps;
    const jumps = parts.flatMap((part) => [...run.channels[part].jumps, ...(solvers[part] ?? [])]);
    lines.push({ solver, values, jumps, most: 10 ** known[known.length - 1] });
  }
  if (!lines.length) {
    svg.replaceChildren();
    find("#gap-title").textContent = "";
    return;
  }
  low = Math.floor(low);
  high = Math.max(Math.ceil(high), low + 1);
  const first = run.xs[0];
  const span = run.xs[run.xs.length - 1] - first || 1;
  const across = (i) => GAP.left + ((run.xs[i] - first) / span) * width;
  const down = (v) => GAP.height - 6 - ((Math.max(v, low - 0.1) - low) / (high - low)) * (GAP.height - 12);
  const step = Math.ceil((high - low) / 4);
  let drawing = "";
  for (let decade = high; decade >= low; decade -= step) {
    const y = down(decade).toFixed(1);
    drawing += `<line class="gap-grid" x1="${GAP.left}" x2="${GAP.left + width}" y1="${y}" y2="${y}"/>`;
    drawing += `<text x="${GAP.left - 7}" y="${Number(y) + 4}" text-anchor="end">${worded(10 ** decade, 1)}</text>`;
  }
  for (const { solver, values, jumps } of lines) {
    const steps = values
      .map((value, i) => ({ value, i, at: `${across(i).toFixed(1)} ${down(value).toFixed(1)}` }))
      .filter(({ value }) => Number.isFinite(value));
    const one = data.solvers[solver];
    const faint = solver === state.solver ? "" : " gap-faint";
    drawing += `<path class="${one.css}${faint}" stroke-dasharray="${one.dash.join(" ")}" d="${strokes(steps, jumps)}"/>`;
  }
  drawing += `<line class="gap-now" y1="0" y2="${GAP.height}"/>`;
  svg.innerHTML = drawing;
  find("#gap-title").textContent = `${words}, logarithmic`;
  const most = lines.map((line) => `${data.solvers[line.solver].label} at most ${worded(line.most)}`);
  svg.setAttribute("aria-label", `${words}: ${most.join("; ")}`);
  moveGapLine();
}

function moveGapLine() {
  const line = find("#gap .gap-now");
  if (line) {
    const { xs } = current();
    const width = Math.max(find("#gap").clientWidth - GAP.left - 8, 60);
    const share = (xs[state.sample] - xs[0]) / (xs[xs.length - 1] - xs[0] || 1);
    line.setAttribute("x1", GAP.left + share * width);
    line.setAttribute("x2", GAP.left + share * width);
  }
}

function pointGap(event) {
  const box = find("#gap").getBoundingClientRect();
  const { xs } = current();
  const share = (event.clientX - box.left - GAP.left) / (box.width - GAP.left - 8);
  const x = xs[0] + Math.min(Math.max(share, 0), 1) * (xs[xs.length - 1] - xs[0]);
  play(false);
  goTo(nearest(xs, x));
}

// ---- the curves

const pair = find("#above")
  ? new CurvePair(find("#above"), find("#below"), {
      point: (sample) => {
        if (playing) {
          readOut(sample);
        } else {
          state.sample = sample;
          drawMechanism();
          pair.scrub(sample);
          readOut(sample);
        }
      },
      left: () => {
        readOut(state.sample);
        save();
      },
      zoomed: (zoom) => {
        state.zoom = zoom;
        find("#whole").hidden = !zoom;
        save();
      },
    })
  : null;

function shownSolvers() {
  const run = current();
  return solversOf(run)
    .filter((name) => state.shown.has(name) && run.solvers[name].differences[state.channel])
    .map((name) => ({
      ...data.solvers[name],
      name,
      difference: run.solvers[name].differences[state.channel],
      shift: run.solvers[name].shifts[state.channel],
      jumps: run.solvers[name].jumps[state.channel] ?? [],
      allowed: judged(comparison(name)) ? comparison(name).allowed : null,
      at: comparison(name)?.at ?? null,
      end: run.solvers[name].early ? (run.failed[name] ? "failed" : "ends") : "",
    }));
}

function drawCurves() {
  const run = current();
  const channel = run.channels[state.channel];
  const solvers = shownSolvers();
  pair.show({
    run,
    channel,
    solvers,
    mode: state.mode,
    zoom: state.zoom,
    sample: state.sample,
  });
  find("#whole").hidden = !state.zoom;
  find("#channel").textContent = state.channel;
  const range = worded(channel.range, 3);
  find("#channel-more").textContent =
    `${channel.kind} [${channel.read || "–"}] over ${run.name}; range ${range} ${channel.unit}`;
  const unit = channel.unit || "1";
  find("#difference-title").textContent = {
    lin: `Difference to the reference [${unit}]; band: allowed; ring: largest`,
    log: `Absolute difference to the reference [${unit}], logarithmic`,
    tol: "Difference to the reference / allowed",
  }[state.mode];
  find("#thinned").textContent =
    (run.every > 1
      ? `Drawn at every ${run.every}${run.every === 2 ? "nd" : run.every === 3 ? "rd" : "th"} of ` +
        `${run.samples} samples; extremes and largest differences are kept.`
      : "") + jumpWords(run, channel, solvers);
  const names = solvers.map((solver) => solver.label).join(", ");
  find("#above").setAttribute(
    "aria-label",
    `${state.channel}: reference and ${names || "no solver"}.${jumpWords(run, channel, solvers)}`,
  );
  const parts = solvers.map((solver) => {
    const c = comparison(solver.name);
    const allowed = judged(c) ? `, allowed ${worded(c.allowed)}` : "";
    return `${solver.label} at most ${worded(c?.error)}${allowed}`;
  });
  find("#below").setAttribute("aria-label", `Difference to the reference: ${parts.join("; ")}`);
  reasons();
  readOut(state.sample);
}

// Format where curves jump; a solver's jumps only if they differ from those of the reference.
function jumpWords(run, channel, solvers) {
  const between = (k) => `between ${atSample(k)} and ${atSample(k + 1)}`;
  const words = (name, jumps) => (jumps.length ? ` ${name} jumps ${formatList(jumps.map(between))}.` : "");
  return [
    words("The reference", channel.jumps),
    ...solvers
      .filter((solver) => solver.jumps.join() !== channel.jumps.join())
      .map((solver) => words(solver.label, solver.jumps)),
  ].join("");
}

// Write below the curves the largest difference of each solver, and the reason of its tolerance.
function reasons() {
  const run = current();
  const channel = run.channels[state.channel];
  const lines = Object.entries(run.solvers).map(([name, solver]) => {
    const { label, css } = data.solvers[name];
    const head = `<b class="${css} coloured">${escaped(label)}</b>`;
    if (run.failed[name]) {
      const until = gone(run, name) ? "" : `, drawn until ${escaped(endOf(run, name))}`;
      return `<p>${head} <b class="bad">${escaped(run.failed[name].outcome)}</b>${until}: ${escaped(run.failed[name].why)}</p>`;
    }
    const c = solver.comparisons[state.channel];
    const stopped = solver.stopped
      ? ` <span class="bad">Ends at ${escaped(endOf(run, name))}: ${escaped(solver.stopped)}</span>`
      : "";
    if (!c) {
      const there = solver.differences?.[state.channel];
      return there ? `<p>${head} real motion of its drive less the motion profile.${stopped}</p>` : "";
    }
    if (!solver.differences?.[state.channel]) {
      return `<p>${head} <span class="soft">not available: ${escaped(c.message)}</span></p>`;
    }
    const at = c.at === null ? "" : ` at ${worded(c.at * run.scale, 4)} ${escaped(run.unit)}`;
    let text =
      c.error === null ? `no number${at}` : `largest ${worded(c.error, 3)} ${escaped(channel.unit)}${at}`;
    if (!judged(c)) {
      return `<p>${head} ${text}, not checked.${stopped}</p>`;
    }
    const ratio = c.ratio === null ? "" : worded(c.ratio);
    text += c.outcome === "differs"
      ? `, <b class="bad">${ratio ? `${ratio} × what is allowed` : escaped(c.message)}</b>.`
      : c.outcome === "undecided" || EMPTY.includes(c.outcome)
      ? `, <b class="bad">${escaped(c.outcome)}</b>: ${escaped(c.message)}.`
      : ratio ? `, ${ratio} of what is allowed.` : ", within what is allowed.";
    const why = c.why ? ` <span class="soft">Why this much is allowed: ${escaped(c.why)}.</span>` : "";
    return `<p>${head} ${text}${why}${stopped}</p>`;
  });
  find("#reasons").innerHTML = lines.join("");
}

// Write the values at a sample into the chips of the solvers.
function readOut(sample) {
  const run = current();
  const channel = run.channels[state.channel];
  for (const chip of findAll("#chips [data-solver]")) {
    const off = run.solvers[chip.dataset.solver].differences?.[state.channel]?.[sample];
    const value = off === undefined ? NaN : off * channel.factor;
    find("output", chip).textContent = `${value > 0 ? "+" : ""}${worded(value)} ${channel.unit}`;
  }
  const value = channel.curve[sample] * channel.read_factor;
  find("#reference-value").textContent =
    `${worded(value, 5)} ${channel.read} at ${atSample(sample)}`;
}

// ---- the lists

function drawList() {
  const run = current();
  const order = ordered(run);
  const most = Math.max(10, ...order.map((one) => one.ratio).filter(Number.isFinite));
  const length = (ratio) => {
    if (ratio <= 0) {
      return 0;
    }
    const share = ratio <= 1 ? Math.max(0, (Math.log10(ratio) + 4) / 4) : 1;
    return 72 * share + (ratio > 1 ? (28 * Math.log10(Math.min(ratio, most))) / Math.log10(most) : 0);
  };
  const items = order.map(({ name, ratio }) => {
    const channel = run.channels[name];
    const outcomes = Object.values(run.solvers).map((one) => one.comparisons[name]?.outcome);
    const coarse = outcomes.includes("undecided") && !outcomes.includes("differs");
    const empty = EMPTY.find((outcome) => outcomes.includes(outcome));
    const bad = ratio > 1 || coarse || Boolean(empty);
    const known = ratio >= 0;
    const sign = coarse ? "?" : known ? (bad ? "✗" : "✓") : "○";
    const wrong = (ratio <= 1 && empty) || "differs";
    const words = coarse ? "undecided" : known ? (bad ? wrong : "agrees") : "not checked";
    return (
      `<div class="item" role="option" id="option-${escaped(name)}" data-channel="${escaped(name)}"` +
      ` aria-selected="${name === state.channel}">` +
      `<span class="${known ? (bad ? "bad" : "ok") : "soft"}" role="img" aria-label="${words}">${sign}</span>` +
      `<span class="item-name" title="${escaped(name)}">${escaped(name)} <span class="soft">${escaped(channel.unit)}</span></span>` +
      `<svg class="spark" viewBox="0 0 56 22" aria-hidden="true"><path d="${spark(channel)}"/></svg>` +
      `<span class="item-ratio ${bad ? "bad" : ""}">${known ? worded(ratio) : "–"}` +
      `<i style="--w:${length(ratio).toFixed(0)}%"></i></span></div>`
    );
  });
  find("#list").innerHTML = items.join("");
  find("#list-title").textContent = `${order.length} channel${order.length > 1 ? "s" : ""}`;
  find("#list").setAttribute("aria-activedescendant", `option-${state.channel}`);
}

function spark({ curve, jumps }) {
  const values = curve.filter(Number.isFinite);
  const low = Math.min(...values);
  const span = Math.max(...values) - low || 1;
  const step = Math.max(1, Math.floor(curve.length / 40));
  const steps = [];
  for (let i = 0; i < curve.length; i += step) {
    const x = (56 * i) / (curve.length - 1 || 1);
    const y = 20 - (18 * (curve[i] - low)) / span;
    if (Number.isFinite(y)) {
      steps.push({ i, at: `${x.toFixed(1)} ${y.toFixed(1)}` });
    }
  }
  return strokes(steps, jumps);
}

// A path through places `at` of samples `i`, which is open at jumps between two of them.
function strokes(steps, jumps) {
  return steps
    .map(({ i, at }, k) => {
      const open = !k || jumps.some((jump) => steps[k - 1].i <= jump && jump < i);
      return `${open ? "M" : "L"}${at}`;
    })
    .join("");
}

// The sign of a solver's markers, as a small picture.
function markerSign(solver) {
  const dash = solver.dash.join(" ");
  return (
    `<svg class="marker ${solver.css}" viewBox="-8 0 28 12" aria-hidden="true">` +
    `<path d="M-8 6h28" stroke-dasharray="${dash}"/>` +
    `<path d="${solver.marker}" transform="translate(6 6)"/></svg>`
  );
}

function drawChips() {
  const run = current();
  find("#runs").innerHTML = runs()
    .map((one) => `<button type="button" role="tab" aria-controls="curves" id="tab-${one.kind}" data-run="${one.kind}" aria-selected="${one === run}" tabindex="${one === run ? 0 : -1}">${one.label}</button>`)
    .join("");
  const chips = Object.keys(run.solvers).map((name, number) => {
    const solver = data.solvers[name];
    const failed = gone(run, name);
    const on = state.shown.has(name) && !failed;
    const words = failed ? escaped(run.failed[name].outcome) : "";
    return (
      `<button type="button" class="chip ${solver.css}" data-solver="${escaped(name)}" aria-pressed="${on}"` +
      ` ${failed ? "disabled" : ""} title="show or hide (${number + 1})">${markerSign(solver)}` +
      `<b>${escaped(solver.label)}</b><output>${words}</output></button>`
    );
  });
  find("#chips").innerHTML =
    '<span class="chip chip-reference"><i class="pale-line"></i> reference <span id="reference-value" class="mono"></span></span>' +
    chips.join("");
  for (const button of findAll("#angles [data-angles]")) {
    button.setAttribute("aria-pressed", (button.dataset.angles === "rad") === state.radians);
  }
  for (const button of findAll("#modes [data-mode]")) {
    button.setAttribute("aria-pressed", button.dataset.mode === state.mode);
  }
  find("#engines").innerHTML = solversOf(run)
    .map((name) => `<button type="button" data-engine="${escaped(name)}" aria-pressed="${name === state.solver}">${escaped(data.solvers[name].label)}</button>`)
    .join("");
  find("#scrub").max = run.x.length - 1;
  const failed = Object.entries(run.failed).map(
    ([name, why]) =>
      `${data.solvers[name].label} is ${gone(run, name) ? "not drawn" : `drawn until ${endOf(run, name)}`}:` +
      ` ${why.outcome}. ${why.why}`,
  );
  for (const [name, solver] of Object.entries(run.solvers)) {
    if (solver.stopped) {
      failed.push(`${data.solvers[name].label} ends at ${endOf(run, name)}: ${solver.stopped}.`);
    }
  }
  find("#failed").textContent = failed.join(" ");
  find("#failed").hidden = !failed.length;
}

// ---- what changes the state

function choose(kind, solver, channel) {
  if (kind !== state.run) {
    state.run = kind;
    state.zoom = null;
    state.sample = 0;
  }
  const run = current();
  const there = solversOf(run);
  state.solver = [solver, state.solver, there[0]].find((name) => there.includes(name));
  const names = ordered(run).map((one) => one.name);
  state.channel = [channel, state.channel, names[0]].find((name) => names.includes(name));
  if (!state.shown) {
    state.shown = new Set();
  }
  for (const name of there) {
    if (!data.solvers[name].variant || there.every((one) => data.solvers[one].variant)) {
      state.shown.add(name);
    }
  }
  if (solver && there.includes(solver)) {
    state.shown.add(solver);
  }
  state.sample = Math.min(state.sample, run.x.length - 1);
}

function drawAll() {
  drawChips();
  drawGap();
  drawList();
  drawCurves();
  drawMechanism();
  save();
}

function goTo(sample, quiet = false) {
  state.sample = sample;
  drawMechanism();
  pair.scrub(sample);
  readOut(sample);
  if (!quiet) {
    save();
  }
}

function chooseChannel(name) {
  state.channel = name;
  drawList();
  drawCurves();
  save();
  find("#list [aria-selected=true]").scrollIntoView({ block: "nearest" });
}

function chooseMode(mode) {
  state.mode = mode;
  drawChips();
  drawCurves();
  save();
}

function wholeRun() {
  state.zoom = null;
  drawCurves();
  save();
}

const ICONS = {
  play: '<svg viewBox="0 0 12 12" aria-hidden="true"><path d="M2 1v10l9-5z"/></svg>',
  pause: '<svg viewBox="0 0 12 12" aria-hidden="true"><path d="M2 1h3v10H2zM7 1h3v10H7z"/></svg>',
};
let playing = false;
let clock = { last: 0, rest: 0 };

function play(on) {
  playing = on;
  const button = find("#play");
  button.innerHTML = on ? ICONS.pause : ICONS.play;
  button.setAttribute("aria-label", on ? "Pause" : "Play");
  if (on) {
    clock = { last: performance.now(), rest: 0 };
    requestAnimationFrame(tick);
  } else {
    save();
  }
}

function tick(now) {
  if (!playing) {
    return;
  }
  const count = current().x.length;
  const speed = Math.min(FRAMES, count / SECONDS) * Math.max(1, count / (FRAMES * SECONDS));
  clock.rest += ((now - clock.last) / 1000) * speed;
  clock.last = now;
  const steps = Math.floor(clock.rest);
  if (steps >= 1) {
    clock.rest -= steps;
    goTo((state.sample + steps) % count, true);
  }
  requestAnimationFrame(tick);
}

// ---- the address: #dynamics/pymunk/pin.x@3.25 and, if they are not as usual,
// ;log or ;tol  ;z=1.2,3.4 (zoom)  ;m=6 (magnification)  ;on=a,b (solvers)  ;rad (angles in radians);
// all values in SI

let ready = false;
let written = "";

function save() {
  if (!ready || playing) {
    return;
  }
  const run = current();
  const plain = (value) => String(Number(value.toPrecision(6)));
  const coded = (word) => encodeURIComponent(word).replaceAll("%3A", ":");
  const parts = [state.run, state.solver, state.channel].map(coded);
  let address = `#${parts.join("/")}@${plain(run.x[state.sample])}`;
  if (state.mode !== "lin") {
    address += `;${state.mode}`;
  }
  if (state.zoom) {
    address += `;z=${state.zoom.map((value) => plain(value / run.scale)).join(",")}`;
  }
  if (state.power) {
    address += `;m=${state.power}`;
  }
  if (state.radians) {
    address += ";rad";
  }
  const there = solversOf(run);
  const usual = there.filter((name) => !data.solvers[name].variant);
  const shown = there.filter((name) => state.shown.has(name));
  if (shown.join() !== (usual.length ? usual : there).join()) {
    address += `;on=${shown.map(coded).join(",")}`;
  }
  if (address !== written) {
    written = address;
    history.replaceState(null, "", address);
  }
}

// Read the address into the state; options that it lacks get their defaults. Returns false if it
// names no curve of this page, otherwise "sample" or "channel", whichever it names.
function load() {
  const [place, ...options] = location.hash.slice(1).split(";");
  const [path, at] = place.split("@");
  const parts = path.split("/").map(decodeURIComponent);
  if (parts.length !== 3 || !data.runs[parts[0]]?.whole || !data.runs[parts[0]].channels[parts[2]]) {
    return false;
  }
  Object.assign(state, { mode: "lin", shown: null, zoom: null, power: 0 });
  showAngles(options.includes("rad"));
  choose(...parts);
  const run = current();
  for (const option of options) {
    const [key, value] = option.split("=");
    const numbers = (value ?? "").split(",").map(Number);
    if (MODES.includes(key)) {
      state.mode = key;
    } else if (key === "z" && numbers.length === 2 && numbers.every(Number.isFinite)) {
      state.zoom = numbers.map((number) => number * run.scale);
    } else if (key === "m" && Number.isInteger(numbers[0])) {
      state.power = Math.min(Math.max(numbers[0], 0), MOST_POWER);
    } else if (key === "on") {
      state.shown = new Set(value.split(",").map(decodeURIComponent));
    }
  }
  if (at !== undefined && Number.isFinite(Number(at))) {
    state.sample = nearest(run.x, Number(at));
    return "sample";
  }
  return "channel";
}

// ---- events

function clicked(event) {
  const link = event.target.closest("a[href^='#']");
  if (link && !link.matches(".skip")) {
    event.preventDefault();
    play(false);
    history.replaceState(null, "", link.getAttribute("href"));
    written = "";
    if (load()) {
      drawAll();
      find("#curves").scrollIntoView({ behavior: still ? "auto" : "smooth", block: "start" });
    }
    return;
  }
  const target = event.target.closest("button, [data-channel]");
  if (!target) {
    return;
  }
  const { channel, run, solver, mode, engine, copy, angles } = target.dataset;
  if (channel) {
    chooseChannel(channel);
  } else if (run) {
    choose(run);
    drawAll();
    find(`#tab-${run}`).focus();
  } else if (solver) {
    toggle(solver);
  } else if (mode) {
    chooseMode(mode);
  } else if (angles) {
    chooseAngles(angles === "rad");
  } else if (engine) {
    state.solver = engine;
    drawChips();
    drawGap();
    drawMechanism();
    readOut(state.sample);
    save();
    find(`[data-engine="${CSS.escape(engine)}"]`).focus();
  } else if (copy !== undefined) {
    copyText(copy || find("code", target.parentElement).innerText, target);
  }
}

function toggle(solver) {
  if (state.shown.has(solver)) {
    state.shown.delete(solver);
  } else {
    state.shown.add(solver);
  }
  drawChips();
  drawCurves();
  save();
  find(`[data-solver="${CSS.escape(solver)}"]`).focus();
}

function pressed(event) {
  const { target, key } = event;
  if (event.ctrlKey || event.metaKey || event.altKey) {
    return;
  }
  if (target.matches("input[type=range]") && key.startsWith("Arrow")) {
    return;
  }
  if (target.matches("button, summary, a") && [" ", "Enter"].includes(key)) {
    return;
  }
  const names = ordered(current()).map((one) => one.name);
  const place = names.indexOf(state.channel);
  const inView = find("#curves").getBoundingClientRect().top < innerHeight * 0.6;
  const listed = target === find("#list") || inView;
  const step = (by) => {
    play(false);
    goTo(Math.min(Math.max(state.sample + by, 0), current().x.length - 1));
  };
  const next = (by) => chooseChannel(names[Math.min(Math.max(place + by, 0), names.length - 1)]);
  const all = runs().map((run) => run.kind);
  const tab = target.matches("[role=tab]");
  const turn = (by) => {
    choose(all[(all.indexOf(state.run) + by + all.length) % all.length]);
    drawAll();
    if (tab) {
      find(`#tab-${state.run}`).focus();
    }
  };
  const actions = {
    ArrowDown: listed && (() => next(1)),
    ArrowUp: listed && (() => next(-1)),
    ArrowRight: () => (tab ? turn(1) : step(1)),
    ArrowLeft: () => (tab ? turn(-1) : step(-1)),
    " ": () => play(!playing),
    l: () => chooseMode(MODES[(MODES.indexOf(state.mode) + 1) % MODES.length]),
    r: () => turn(1),
    0: wholeRun,
  };
  const number = Number(key);
  if (number >= 1 && number <= 9) {
    findAll("#chips [data-solver]")[number - 1]?.click();
  } else if (actions[key]) {
    event.preventDefault();
    actions[key]();
  }
}

function listen() {
  document.addEventListener("click", clicked);
  document.addEventListener("keydown", pressed);
  find("#play").addEventListener("click", () => play(!playing));
  find("#scrub").addEventListener("input", (event) => {
    play(false);
    goTo(Number(event.target.value));
  });
  find("#magnification").addEventListener("input", (event) => {
    state.power = Number(event.target.value);
    drawMechanism();
    save();
  });
  find("#visible").addEventListener("click", () => {
    state.power = mechanism()?.power(state.solver) ?? 0;
    drawMechanism();
    save();
  });
  find("#whole").addEventListener("click", wholeRun);
  const gap = find("#gap");
  gap.addEventListener("pointerdown", (event) => {
    gap.setPointerCapture(event.pointerId);
    pointGap(event);
  });
  gap.addEventListener("pointermove", (event) => event.buttons && pointGap(event));
  addEventListener("hashchange", () => {
    if (location.hash !== written && load()) {
      play(false);
      drawAll();
    }
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
  let opened = [];
  addEventListener("beforeprint", () => {
    play(false);
    opened = findAll(".more > details:not([open]):not(.source)");
    opened.forEach((one) => one.setAttribute("open", ""));
    drawCurves();
  });
  addEventListener("afterprint", () => {
    opened.forEach((one) => one.removeAttribute("open"));
    drawCurves();
  });
  let wait = 0;
  let width = find("#above").clientWidth;
  new ResizeObserver(() => {
    clearTimeout(wait);
    wait = setTimeout(() => {
      if (Math.abs(find("#above").clientWidth - width) > 2) {
        width = find("#above").clientWidth;
        drawCurves();
        drawGap();
      }
    }, 80);
  }).observe(find("#above"));
}

function start() {
  decode();
  const all = runs();
  if (!all.length) {
    return;
  }
  document.body.classList.add("scripted");
  showAngles(false);
  find("#angles").hidden = !hasAngles();
  find("#player").hidden = false;
  find("#curves").hidden = false;
  const named = load();
  if (!named) {
    const differs = all.find((run) => ordered(run)[0].ratio > 1);
    const failed = all.find((run) => Object.keys(run.failed).some((name) => !gone(run, name)));
    const first = differs ?? failed ?? all[all.length - 1];
    choose(first.kind, Object.keys(first.failed).find((name) => !gone(first, name)));
    if (differs) {
      state.power = Math.max(0, mechanism()?.power(state.solver) ?? 0);
    }
  }
  ready = true;
  drawAll();
  listen();
  play(named !== "sample" && !still && Boolean(data.motions[state.run]));
}

start();

// The work-precision diagram: a marker for each setting, error against cost, both logarithmic.
// Its texts and the events of pointer and keyboard are in trade.js.
"use strict";

const MARGIN = { left: 62, right: 22, top: 18, bottom: 44 };
const NEAR = 12; // [px] largest distance of ends of series whose letters are written side by side
const FAILED = "M-4-4l8 8M4-4l-8 8";

const data = JSON.parse(find("#data").textContent);
const kindOf = new Map(data.kinds.map((kind) => [kind.key, kind]));

const state = {
  kind: data.kinds[0]?.key,
  cost: "seconds",
  off: new Set(), // indices of series that are not drawn
  zoom: null, // [x low, x high, y low, y high]
  at: null, // the chosen setting
};
let hovered = null; // the setting under the pointer
let view = null; // what was drawn last: scales and places of the settings

const kind = () => kindOf.get(state.kind);
const errorOf = (setting) => setting.errors[state.kind];
const costOf = (setting) => (state.cost === "seconds" ? setting.seconds[1] : setting.work);
const front = () => (state.cost === "seconds" ? kind().front : kind().fewest);
const tied = () => (state.cost === "seconds" ? kind().tied : []);

function isShown(setting) {
  return !state.off.has(setting.series) && costOf(setting) > 0 && (!setting.ran || errorOf(setting) > 0);
}

// ------------------------------------------------------------------ scales

// The decades that contain some values.
function wholeDecades(values, share) {
  const logs = values.map(Math.log10);
  return [
    10 ** (Math.floor(Math.min(...logs) / share) * share),
    10 ** (Math.ceil((Math.max(...logs) + 1e-9) / share) * share),
  ];
}

function domain() {
  if (state.zoom) {
    return state.zoom;
  }
  const shown = data.settings.filter((setting) => costOf(setting) > 0);
  const costs = shown.flatMap((one) => (state.cost === "seconds" ? one.seconds : [one.work]));
  const errors = shown.map(errorOf).filter((error) => error > 0);
  const x = costs.length ? wholeDecades(costs, 0.5) : [0.001, 1];
  const y = errors.length ? wholeDecades(errors.map(bounded), 1) : [1e-6, 1];
  return [...x, ...y];
}

const bounded = (error) => Math.min(error, data.top);

function costWords(value) {
  if (state.cost !== "seconds") {
    return worded(value, 1).replace(/e(\d)/, "e$1");
  }
  return timeWords(value);
}

// ------------------------------------------------------------------ drawing

function draw() {
  const box = find("#plot");
  const focused = document.activeElement?.closest("#plot") !== null && document.activeElement !== null;
  const [width, height] = [box.clientWidth, box.clientHeight];
  const [xLow, xHigh, yLow, yHigh] = domain();
  const [right, bottom] = [width - MARGIN.right, height - MARGIN.bottom];
  view = {
    x: scale(xLow, xHigh, MARGIN.left, right),
    y: scale(yLow, yHigh, bottom, MARGIN.top),
    places: new Map(),
    right,
    bottom,
  };
  data.settings.forEach((setting, number) => {
    if (isShown(setting)) {
      const y = setting.ran ? view.y.place(bounded(errorOf(setting))) : MARGIN.top - 8;
      view.places.set(number, [view.x.place(costOf(setting)), y]);
    }
  });
  const svg = element("svg", { width, height, viewBox: `0 0 ${width} ${height}` });
  svg.append(
    drawAxes(width, [xLow, xHigh, yLow, yHigh]),
    element(
      "clipPath",
      { id: "inside" },
      element("rect", { x: MARGIN.left, y: 0, width: right - MARGIN.left, height: bottom }),
    ),
  );
  const inside = element("g", { "clip-path": "url(#inside)", "aria-hidden": "true" });
  inside.append(drawFront(), ...data.series.flatMap(drawLine));
  svg.append(inside, drawSurface(right, bottom), drawPoints(), drawLetters());
  svg.append(element("g", { id: "rings", "aria-hidden": "true" }));
  box.replaceChildren(svg);
  wirePointer(svg);
  find("#whole").hidden = !state.zoom;
  if (focused) {
    find("#points").focus();
  }
  drawRings();
}

function drawAxes(width, [xLow, xHigh, yLow, yHigh]) {
  const { x, y, right, bottom } = view;
  const axes = element("g", { "aria-hidden": "true" });
  for (const value of ticks(xLow, xHigh, width < 520 ? 4 : 9)) {
    const at = x.place(value);
    axes.append(
      element("line", { class: "grid", x1: at, x2: at, y1: MARGIN.top, y2: bottom }),
      element("text", { x: at, y: bottom + 17, "text-anchor": "middle" }, costWords(value)),
    );
  }
  for (const value of ticks(yLow, yHigh, 8)) {
    const at = y.place(value);
    axes.append(
      element("line", { class: "grid", x1: MARGIN.left, x2: right, y1: at, y2: at }),
      element("text", { x: MARGIN.left - 7, y: at + 4, "text-anchor": "end" }, worded(value, 1)),
    );
  }
  const cost = state.cost === "seconds" ? "processor time of the run" : data.work;
  const middle = (MARGIN.top + bottom) / 2;
  axes.append(
    element("rect", {
      class: "frame",
      x: MARGIN.left,
      y: MARGIN.top,
      width: right - MARGIN.left,
      height: bottom - MARGIN.top,
    }),
    element("text", { x: (MARGIN.left + right) / 2, y: bottom + 37, "text-anchor": "middle" }, cost),
    element(
      "text",
      { transform: `translate(14 ${middle}) rotate(-90)`, "text-anchor": "middle" },
      `${kind().title.toLowerCase()} error, share of the range`,
    ),
  );
  return axes;
}

// The Pareto front as a stair; for processor times also the band in which it lies by their spread.
function drawFront() {
  const { x, y, right } = view;
  const group = element("g");
  const corners = front()
    .map((number) => data.settings[number])
    .map((setting) => [x.place(costOf(setting)), y.place(bounded(errorOf(setting)))])
    .sort((one, two) => two[0] - one[0]);
  if (state.cost === "seconds") {
    const places = kind().band.map(([error, ...costs]) => [y.place(bounded(error)), ...costs.map(x.place)]);
    const lower = stairs(places.map(([at, low]) => [low, at]), right);
    const upper = stairs(places.map(([at, , high]) => [high, at]), right);
    group.append(element("path", { class: "front", d: polyline([...lower, ...upper.reverse()]) }));
  }
  group.append(element("path", { class: "stairs", d: polyline(stairs(corners, right)) }));
  return group;
}

function polyline(places) {
  return places.length ? `M${places.map((place) => place.map((at) => at.toFixed(1)).join(" ")).join("L")}` : "";
}

// Corners of a stair through places from lower right to upper left, extended to both edges.
function stairs(corners, right) {
  const found = [];
  let from = right;
  for (const [across, down] of corners) {
    found.push([from, down], [across, down]);
    from = across;
  }
  if (corners.length) {
    found.push([from, MARGIN.top]);
  }
  return found;
}

function drawLine(series, number) {
  if (state.off.has(number)) {
    return [];
  }
  const group = element("g", { class: series.css, "data-series": number });
  const own = [...view.places].filter(([k]) => data.settings[k].series === number);
  const ran = own.filter(([k]) => data.settings[k].ran);
  if (ran.length) {
    const dash = series.dash.map((part) => 1.6 * part).join(" ") || "none";
    const d = polyline(ran.map(([, place]) => place));
    group.append(element("path", { class: "line", d, "stroke-dasharray": dash }));
  }
  if (state.cost === "seconds") {
    for (const [k, [, y]] of ran) {
      const [low, , high] = data.settings[k].seconds.map(view.x.place);
      group.append(element("line", { class: "spread", x1: low, x2: high, y1: y, y2: y }));
    }
  }
  const floor = kind().floors.find((one) => one.series === number);
  if (floor && ran.length) {
    const [x, y] = [ran.at(-1)[1][0], view.y.place(floor.level)];
    group.append(element("line", { class: "floor", x1: x - 12, x2: x + 12, y1: y, y2: y }));
  }
  return [group];
}

function drawSurface(right, bottom) {
  return element("rect", {
    class: "surface",
    x: MARGIN.left,
    y: 0,
    width: Math.max(0, right - MARGIN.left),
    height: bottom,
  });
}

// The markers, as options of a list that the keyboard can select.
function drawPoints() {
  const points = element("g", {
    id: "points",
    role: "listbox",
    tabindex: 0,
    "aria-label": `${kind().title} error against cost: ${view.places.size} settings`,
  });
  const [best, maybe] = [new Set(front()), new Set(tied())];
  for (const [number, place] of view.places) {
    if (!isInside(place)) {
      continue;
    }
    const setting = data.settings[number];
    const series = data.series[setting.series];
    const rank = best.has(number) ? "best" : maybe.has(number) ? "tied" : "";
    const option = element("g", {
      id: `setting-${number}`,
      role: "option",
      "aria-selected": String(state.at === number),
      "aria-label": spokenSetting(number),
      class: `point ${series.css} ${setting.ran ? rank : "failed"}`,
      transform: `translate(${place[0].toFixed(1)} ${place[1].toFixed(1)})`,
      "pointer-events": "none",
    });
    option.append(element("path", { d: setting.ran ? series.mark : FAILED }));
    points.append(option);
  }
  if (state.at !== null && view.places.has(state.at)) {
    points.setAttribute("aria-activedescendant", `setting-${state.at}`);
  }
  points.addEventListener("keydown", moved);
  points.addEventListener("focus", () => {
    if (state.at === null || !view.places.has(state.at)) {
      choose(front()[0] ?? view.places.keys().next().value ?? null);
    } else {
      drawRings();
    }
  });
  return points;
}

function isInside([x, y]) {
  return x >= MARGIN.left - 1 && x <= view.right + 1 && y >= 0 && y <= view.bottom + 1;
}

// The letter of each series at its last setting; letters of series that end together side by side.
function drawLetters() {
  const letters = element("g", { "aria-hidden": "true" });
  const groups = [];
  data.series.forEach((series, number) => {
    const own = [...view.places].filter(([k]) => data.settings[k].series === number && data.settings[k].ran);
    const end = own.at(-1)?.[1];
    if (!end || !isInside(end)) {
      return;
    }
    const near = groups.find(([x, y]) => Math.max(Math.abs(x - end[0]), Math.abs(y - end[1])) < NEAR);
    if (near) {
      near[2].push(series);
    } else {
      groups.push([...end, [series]]);
    }
  });
  for (const [x, y, names] of groups) {
    const text = element("text", { x: Math.min(x + 9, view.right + 4), y: Math.min(y + 14, view.bottom - 4) });
    for (const series of names) {
      text.append(element("tspan", { class: `letter ${series.css}` }, `${series.letter} `));
    }
    letters.append(text);
  }
  return letters;
}

// Rings around the chosen setting and the one under the pointer, with the text of the latter.
function drawRings() {
  const rings = find("#rings");
  rings.replaceChildren();
  for (const [number, name] of [
    [state.at, "ring picked"],
    [hovered, "ring"],
  ]) {
    const place = view.places.get(number);
    if (place && isInside(place)) {
      rings.append(element("circle", { class: name, cx: place[0], cy: place[1], r: 8.5 }));
    }
  }
  const tip = find("#tip");
  const focused = document.activeElement?.id === "points" ? state.at : null;
  const number = hovered ?? focused;
  const place = view.places.get(number);
  tip.hidden = !place || !isInside(place);
  if (tip.hidden) {
    return;
  }
  const setting = data.settings[number];
  tip.className = `tip ${data.series[setting.series].css}`;
  tip.innerHTML = tipWords(number);
  const plot = find("#plot");
  const [left, top] = [plot.offsetLeft + place[0], plot.offsetTop + place[1]];
  const across = left > plot.clientWidth / 2 ? left - tip.offsetWidth - 16 : left + 16;
  tip.style.left = `${Math.max(4, Math.min(across, plot.clientWidth - tip.offsetWidth))}px`;
  tip.style.top = `${Math.max(0, Math.min(top - 20, plot.clientHeight - tip.offsetHeight))}px`;
}

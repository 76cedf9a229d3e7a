// The page of a trade study: texts of settings, pointer and keyboard, controls and address.
// diagram.js draws the diagram.
"use strict";

const REACH = 28; // [px] largest distance of the pointer to the marker that it selects
const TINY = 6; // [px] a shorter drag is a click

// ------------------------------------------------------------------ words

function rankWords(number) {
  if (front().includes(number)) {
    return state.cost === "seconds"
      ? "on the front: no measured setting is cheaper with no larger error"
      : "on the front: no setting with fewer steps has as small an error";
  }
  if (tied().includes(number)) {
    return "tied with the front: the times do not decide whether another is cheaper";
  }
  return state.cost === "seconds"
    ? "beaten: another setting is cheaper with no larger error"
    : "beaten: another setting has fewer steps with no larger error";
}

function spokenSetting(number) {
  const setting = data.settings[number];
  const cost = setting.time || (setting.work ? `${setting.work} ${data.work}` : "no time");
  if (!setting.ran) {
    return `${setting.words}: ${setting.outcome}`;
  }
  return `${setting.words}: ${kind().title.toLowerCase()} error ${worded(errorOf(setting))}, ${cost}; ${rankWords(number)}`;
}

function tipWords(number) {
  const setting = data.settings[number];
  const first = `<b>${escaped(setting.words)}</b>`;
  if (!setting.ran) {
    return `${first}<br>${escaped(setting.outcome)}`;
  }
  const steps = setting.work ? ` · ${worded(setting.work, 3)} ${data.work}` : "";
  return `${first}<br>error ${worded(errorOf(setting))} of range<br>${escaped(setting.time)}${steps}<br>${rankWords(number)}`;
}

// Show all numbers of a setting beside the diagram.
function tellSetting(number) {
  const panel = find("#setting");
  const setting = data.settings[number];
  if (!setting) {
    panel.className = "setting";
    panel.innerHTML = '<p class="soft">Point to a marker, or reach it with Tab and the arrow keys: its setting, its errors, its cost and the lines to paste are shown here.</p>';
    return;
  }
  const series = data.series[setting.series];
  panel.className = `setting ${series.css}`;
  const rows = data.kinds
    .filter((one) => setting.errors[one.key] !== undefined)
    .map((one) => row(`${one.title} error`, worded(setting.errors[one.key]), one.key === state.kind));
  const many = setting.repeats === 1 ? ", one run" : `, ${setting.repeats} runs`;
  rows.push(
    row("Wall time", setting.time && setting.time + (setting.repeats ? many : "")),
    row(data.work === "segments" ? "Segments" : "Time steps", setting.work && worded(setting.work, 3)),
    row("Step taken", setting.step),
    row("Constraint violation", setting.violation !== null && `${worded(setting.violation)} m`),
    row("Energy drift", setting.energy !== null && worded(setting.energy)),
    row("Load average", setting.load !== null && worded(setting.load)),
    row(`${kind().title}, its convergence series`, series.orders[state.kind]),
  );
  const floor = kind().floors.find((one) => one.series === setting.series);
  const limit = floor
    ? `<p class="small soft">Its convergence series stays at ${worded(floor.level)}: ${escaped(floor.cause)}. Evidence: ${escaped(floor.evidence)}.</p>`
    : "";
  const rank = setting.ran ? rankWords(number) : setting.outcome;
  panel.innerHTML = `<h3>${escaped(series.letter)} · ${escaped(setting.words)}</h3>
<p class="${setting.ran ? "soft" : "bad"} small">${escaped(rank[0].toUpperCase() + rank.slice(1))}.</p>
<table><tbody>${rows.join("")}</tbody></table>${limit}
<div class="snippet"><pre tabindex="0" aria-label="What to paste">${escaped(setting.text)}</pre><button type="button" data-copy hidden>Copy</button></div>`;
  wireCopies(panel);
}

function row(name, value, now = false) {
  return value ? `<tr${now ? ' class="now"' : ""}><th scope="row">${escaped(name)}</th><td>${escaped(value)}</td></tr>` : "";
}

// ------------------------------------------------------------------ pointer and keyboard

function nearestSetting(x, y) {
  let best = null;
  let least = REACH;
  for (const [number, place] of view.places) {
    const distance = Math.hypot(place[0] - x, place[1] - y);
    if (distance < least && isInside(place)) {
      [best, least] = [number, distance];
    }
  }
  return best;
}

function wirePointer(svg) {
  let start = null;
  let box = null;
  const at = (event) => {
    const frame = svg.getBoundingClientRect();
    return [event.clientX - frame.left, event.clientY - frame.top];
  };
  svg.addEventListener("pointerdown", (event) => {
    start = at(event);
    if (event.pointerType === "mouse") {
      svg.setPointerCapture(event.pointerId);
    }
  });
  svg.addEventListener("pointermove", (event) => {
    const now = at(event);
    if (!start || event.pointerType !== "mouse") {
      hover(nearestSetting(...now));
      return;
    }
    if (!box && Math.hypot(now[0] - start[0], now[1] - start[1]) > TINY) {
      box = element("rect", { class: "zoom" });
      svg.append(box);
    }
    if (box) {
      box.setAttribute("x", Math.min(start[0], now[0]));
      box.setAttribute("y", Math.min(start[1], now[1]));
      box.setAttribute("width", Math.abs(now[0] - start[0]));
      box.setAttribute("height", Math.abs(now[1] - start[1]));
    }
  });
  svg.addEventListener("pointerup", (event) => {
    const now = at(event);
    if (box) {
      zoomTo(start, now);
    } else if (start) {
      const number = nearestSetting(...now);
      if (number !== null) {
        choose(number);
        copyChosen();
      }
    }
    [start, box] = [null, null];
  });
  svg.addEventListener("pointerleave", () => hover(null));
  svg.addEventListener("dblclick", whole);
}

function hover(number) {
  if (number === hovered) {
    return;
  }
  hovered = number;
  for (const group of findAll("#plot [data-series]")) {
    const faded = number !== null && Number(group.dataset.series) !== data.settings[number].series;
    group.classList.toggle("faded", faded);
  }
  drawRings();
  tellSetting(number ?? state.at);
}

function choose(number) {
  state.at = number;
  const points = find("#points");
  for (const option of findAll("[aria-selected=true]", points)) {
    option.setAttribute("aria-selected", "false");
  }
  const option = find(`#setting-${number}`, points);
  option?.setAttribute("aria-selected", "true");
  if (option) {
    points.setAttribute("aria-activedescendant", option.id);
  }
  drawRings();
  tellSetting(number);
  keep();
}

function copyChosen() {
  const setting = data.settings[state.at];
  if (setting) {
    copyText(setting.text, find("#setting [data-copy]"));
  }
}

function zoomTo([x1, y1], [x2, y2]) {
  const { x, y } = view;
  const limits = (low, high, from, to) => [Math.max(low, from), Math.min(high, to)];
  const across = limits(Math.min(x1, x2), Math.max(x1, x2), MARGIN.left, view.right);
  const down = limits(Math.min(y1, y2), Math.max(y1, y2), MARGIN.top, view.bottom);
  if (across[1] - across[0] > TINY && down[1] - down[0] > TINY) {
    state.zoom = [x.value(across[0]), x.value(across[1]), y.value(down[1]), y.value(down[0])];
    change();
  }
}

function whole() {
  state.zoom = null;
  change();
}

// Arrow keys: along a series, or to the nearest setting of another series above or below.
function moved(event) {
  const place = view.places.get(state.at);
  if (event.key === "Enter" || event.key === " ") {
    event.preventDefault();
    copyChosen();
    return;
  }
  if (!event.key.startsWith("Arrow") || !place) {
    return;
  }
  event.preventDefault();
  const series = data.settings[state.at].series;
  const all = [...view.places].filter(([, at]) => isInside(at));
  if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
    const own = all.filter(([k]) => data.settings[k].series === series).sort((one, two) => one[1][0] - two[1][0]);
    const k = own.findIndex(([number]) => number === state.at) + (event.key === "ArrowRight" ? 1 : -1);
    if (own[k]) {
      choose(own[k][0]);
    }
    return;
  }
  const sign = event.key === "ArrowDown" ? 1 : -1;
  let best = null;
  let least = Infinity;
  for (const [number, at] of all) {
    const down = sign * (at[1] - place[1]);
    const distance = Math.hypot(2 * (at[0] - place[0]), down);
    if (data.settings[number].series !== series && down > 0 && distance < least) {
      [best, least] = [number, distance];
    }
  }
  if (best !== null) {
    choose(best);
  }
}

// ------------------------------------------------------------------ controls and address

function chip(words, pressed, toggle, css = "") {
  const button = document.createElement("button");
  button.type = "button";
  button.className = `chip ${css}`;
  button.setAttribute("aria-pressed", String(pressed));
  button.innerHTML = words;
  button.addEventListener("click", toggle);
  return button;
}

function drawChips() {
  const box = find("#chips");
  const engines = [...new Set(data.series.map((series) => series.engine))];
  const made = engines.map((engine) => {
    const own = data.series.flatMap((series, k) => (series.engine === engine ? [k] : []));
    const on = own.some((k) => !state.off.has(k));
    const said = escaped(data.series[own[0]].title);
    return chip(`All of ${said}`, on, () => toggle(own, on), "group");
  });
  data.series.forEach((series, k) => {
    const mark = `<svg class="mark" viewBox="-6 -6 12 12" aria-hidden="true"><path d="${series.mark}"/></svg>`;
    const words = `${mark}<b>${series.letter}</b> ${escaped(series.name)}`;
    const on = !state.off.has(k);
    const own = chip(words, on, () => toggle([k], on), series.css);
    own.dataset.series = k;
    made.push(own);
  });
  const focused = [...box.children].indexOf(document.activeElement);
  box.replaceChildren(...made);
  box.children[focused]?.focus();
}

function toggle(series, on) {
  for (const k of series) {
    if (on) {
      state.off.add(k);
    } else {
      state.off.delete(k);
    }
  }
  change();
}

// Show the state, and store it in the address.
function change() {
  for (const button of findAll("#kinds button")) {
    button.setAttribute("aria-pressed", String(button.dataset.kind === state.kind));
  }
  for (const button of findAll("#costs button")) {
    button.setAttribute("aria-pressed", String(button.dataset.cost === state.cost));
  }
  for (const part of findAll(".of-kind")) {
    part.hidden = part.dataset.kind !== state.kind;
  }
  drawChips();
  draw();
  tellSetting(state.at);
  keep();
}

function keep() {
  writeAddress({
    kind: state.kind,
    cost: state.cost === "seconds" ? "" : state.cost,
    off: [...state.off].map((k) => data.series[k].letter).join(","),
    zoom: state.zoom?.map((value) => Number(value.toPrecision(4))).join(",") ?? "",
    at: state.at === null ? "" : String(state.at),
  });
}

function recall() {
  const address = readAddress();
  if (kindOf.has(address.get("kind"))) {
    state.kind = address.get("kind");
  }
  state.cost = address.get("cost") === "work" ? "work" : "seconds";
  const off = (address.get("off") ?? "").split(",");
  state.off = new Set(data.series.flatMap((series, k) => (off.includes(series.letter) ? [k] : [])));
  const zoom = (address.get("zoom") ?? "").split(",").map(Number);
  state.zoom = zoom.length === 4 && zoom.every((value) => value > 0) ? zoom : null;
  const at = Number(address.get("at") ?? NaN);
  state.at = data.settings[at] ? at : null;
}

function pickKind(key) {
  state.kind = key;
  state.zoom = null;
  change();
}

function pickCost(cost) {
  state.cost = cost;
  state.zoom = null;
  change();
}

function wire() {
  for (const button of findAll("#kinds button")) {
    button.addEventListener("click", () => pickKind(button.dataset.kind));
  }
  for (const button of findAll("#costs button")) {
    button.addEventListener("click", () => pickCost(button.dataset.cost));
  }
  for (const button of findAll("[data-show]")) {
    button.hidden = false;
    button.addEventListener("click", () => {
      const number = Number(button.dataset.show);
      state.zoom = null;
      state.off.delete(data.settings[number].series);
      state.at = number;
      change();
      find("#diagram").scrollIntoView();
      find("#points").focus();
    });
  }
  find("#whole").addEventListener("click", whole);
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, textarea")) {
      return;
    }
    const number = Number(event.key);
    if (event.key === "0") {
      whole();
    } else if (event.key === "c" || event.key === "C") {
      pickCost(state.cost === "seconds" ? "work" : "seconds");
    } else if (data.kinds[number - 1]) {
      pickKind(data.kinds[number - 1].key);
    }
  });
  addEventListener("hashchange", () => {
    recall();
    change();
  });
  new ResizeObserver(() => draw()).observe(find("#plot"));
  addEventListener("beforeprint", draw);
}

if (data.kinds.length) {
  find("#diagram").hidden = false;
  find("#kind-row").hidden = data.kinds.length < 2;
  recall();
  wire();
  change();
}

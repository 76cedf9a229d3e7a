"use strict";

// The table is complete without this script, which filters and sorts it and moves the drawings.

const table = document.getElementById("cases");
const poses = JSON.parse(document.getElementById("poses").textContent);
const EMPTY = { q: "", outcome: "", engine: "", family: "", sort: "", down: "" };
const state = { ...EMPTY };
const STEP = 60; // [ms] per pose
const RISING = ["name", "checked"]; // columns that are sorted in rising order first, others falling

// ---- Filters

const OUTCOMES = {
  agree: (row) => row.dataset.state === "good",
  differ: (row) => row.dataset.state === "bad",
  gaps: (row) => Number(row.dataset.gaps) > 0,
  changed: (row) => Number(row.dataset.changes) > 0,
};

function fits(row, words) {
  const { search, family, engines, failing } = row.dataset;
  if (!words.every((word) => search.includes(word))) {
    return false;
  }
  if (state.family && !(family === state.family || isFolder(family, state.family))) {
    return false;
  }
  if (state.engine && !engines.split(" ").includes(state.engine)) {
    return false;
  }
  if (state.engine && state.outcome === "differ" && failing) {
    return failing.split(" ").includes(state.engine);
  }
  return !state.outcome || OUTCOMES[state.outcome](row);
}

function isFolder(family, chosen) {
  return chosen.endsWith("/") && family.startsWith(chosen);
}

// ---- Order

// The sort key of a row: the least comes first, unless the state is "down".
function cellValue(row, key) {
  const cell = find(`td[data-column="${CSS.escape(key)}"]`, row);
  if (!cell) {
    return -Infinity;
  }
  return cell.dataset.value === "inf" ? Infinity : Number(cell.dataset.value);
}

function sortValue(row, key) {
  if (key === "name") {
    return row.dataset.name;
  }
  if (key === "change") {
    return -(1000 * Number(row.dataset.worse) + Number(row.dataset.changes));
  }
  if (key === "checked") {
    return Number(row.dataset.checked);
  }
  if (key === "seconds") {
    return -Number(row.dataset.seconds);
  }
  if (key) {
    return -cellValue(row, key);
  }
  return Number(row.dataset.order);
}

function ordered(rows) {
  const direction = state.down ? -1 : 1;
  const keyed = rows.map((row) => [sortValue(row, state.sort), Number(row.dataset.order), row]);
  keyed.sort((a, b) => {
    if (a[0] === b[0]) {
      return a[1] - b[1];
    }
    return a[0] < b[0] ? -direction : direction;
  });
  return keyed.map((each) => each[2]);
}

// ---- Visible rows

function draw() {
  const words = state.q.toLowerCase().split(/\s+/).filter(Boolean);
  const rows = findAll("tbody tr[data-name]", table);
  const body = find("tbody", table);
  let count = 0;
  for (const row of ordered(rows)) {
    row.hidden = !fits(row, words);
    count += row.hidden ? 0 : 1;
    body.append(row);
  }
  body.append(find("#none"));
  find("#none").hidden = count > 0;
  const cases = rows.length === 1 ? "case" : "cases";
  find("#count").textContent =
    count === rows.length ? `${count} ${cases}` : `${count} of ${rows.length} ${cases}`;
  for (const cell of findAll("[data-of]", table)) {
    cell.hidden = Boolean(state.engine) && cell.dataset.of !== state.engine;
  }
  drawControls();
  keepAddress();
}

function drawControls() {
  for (const button of findAll(".number")) {
    button.setAttribute("aria-pressed", String(state.outcome === button.dataset.outcome));
  }
  for (const button of findAll("[data-engine]")) {
    button.setAttribute("aria-pressed", String(state.engine === button.dataset.engine));
  }
  for (const head of findAll("th", table)) {
    const button = find("button", head);
    if (button && state.sort && button.dataset.sort === state.sort) {
      const rising = RISING.includes(state.sort) === !state.down;
      head.setAttribute("aria-sort", rising ? "ascending" : "descending");
    } else {
      head.removeAttribute("aria-sort");
    }
  }
  if (find("#search").value !== state.q) {
    find("#search").value = state.q;
  }
  find("#family").value = state.family;
  const chosen = find("#family").selectedOptions[0];
  const about = find("#about-family");
  about.textContent = chosen ? chosen.title : "";
  about.hidden = !about.textContent;
}

// ---- State in the address

function keepAddress() {
  const kept = new URLSearchParams();
  for (const [name, value] of Object.entries(state)) {
    if (value) {
      kept.set(name, value);
    }
  }
  const hash = kept.toString();
  history.replaceState(null, "", hash ? `#${hash}` : location.pathname + location.search);
}

function readAddress() {
  const kept = new URLSearchParams(location.hash.slice(1));
  for (const name of Object.keys(EMPTY)) {
    state[name] = kept.get(name) || "";
  }
  if (!(state.outcome in OUTCOMES)) {
    state.outcome = "";
  }
  const engines = findAll("[data-engine]").map((button) => button.dataset.engine);
  if (!engines.includes(state.engine)) {
    state.engine = "";
  }
  const families = findAll("#family option").map((option) => option.value);
  if (!families.includes(state.family)) {
    state.family = "";
  }
}

function change(changes) {
  Object.assign(state, changes);
  draw();
}

function sortBy(key) {
  if (state.sort !== key) {
    change({ sort: key, down: "" });
  } else if (!state.down) {
    change({ down: "1" });
  } else {
    change({ sort: "", down: "" });
  }
}

// ---- Animated drawings

const playing = { timer: 0, svg: null };
const still = matchMedia("(prefers-reduced-motion: reduce)");

function bytes(shape) {
  if (!shape.bytes) {
    shape.bytes = unpacked(shape.points, "u1");
  }
  return shape.bytes;
}

function show(svg, shape, pose) {
  const length = bytes(shape).length / shape.poses;
  const here = bytes(shape).subarray(pose * length, (pose + 1) * length);
  let next = 0;
  findAll(".link", svg).forEach((path, k) => {
    const size = shape.sizes[k];
    const points = here.subarray(next, next + 2 * size);
    next += 2 * size;
    path.setAttribute("d", `M${points.join(" ")}${size > 2 ? "Z" : ""}`);
  });
  for (const joint of findAll(".joint", svg)) {
    joint.setAttribute("transform", `translate(${here[next]} ${here[next + 1]})`);
    next += 2;
  }
}

function stop() {
  if (playing.svg) {
    clearInterval(playing.timer);
    const shape = poses[playing.svg.dataset.name];
    show(playing.svg, shape, shape.shown);
    playing.svg = null;
  }
}

function play(row) {
  const svg = row && find(".thumbnail", row);
  if (svg === playing.svg) {
    return;
  }
  stop();
  const shape = svg && poses[svg.dataset.name];
  if (!shape || shape.poses < 2 || still.matches) {
    return;
  }
  let pose = shape.shown;
  playing.svg = svg;
  playing.timer = setInterval(() => {
    pose = (pose + 1) % shape.poses;
    show(svg, shape, pose);
  }, STEP);
}

// ---- Events

function rowOf(event) {
  return event.target instanceof Element ? event.target.closest("tbody tr[data-name]") : null;
}

function listen() {
  find(".bar").addEventListener("submit", (event) => event.preventDefault());
  find("#search").addEventListener("input", (event) => change({ q: event.target.value }));
  find("#family").addEventListener("change", (event) => change({ family: event.target.value }));
  find("#clear").addEventListener("click", () => change({ ...EMPTY, sort: state.sort, down: state.down }));
  for (const button of findAll(".number")) {
    const { outcome } = button.dataset;
    button.addEventListener("click", () => {
      change({ outcome: state.outcome === outcome ? "" : outcome });
    });
  }
  for (const button of findAll("[data-engine]")) {
    button.addEventListener("click", () => change({ engine: button.dataset.engine }));
  }
  for (const button of findAll("th button", table)) {
    button.addEventListener("click", () => sortBy(button.dataset.sort));
  }
  for (const link of findAll("#families a")) {
    link.addEventListener("click", (event) => {
      event.preventDefault();
      change({ ...EMPTY, family: link.dataset.family });
      find("#family").focus();
    });
  }
  document.addEventListener("pointerover", (event) => play(rowOf(event)));
  document.addEventListener("focusin", (event) => play(rowOf(event)));
  document.addEventListener("keydown", (event) => {
    const typing = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName);
    if (event.key === "/" && !typing && !event.ctrlKey && !event.metaKey && !event.altKey) {
      event.preventDefault();
      find("#search").focus();
    } else if (event.key === "Escape" && state.q) {
      change({ q: "" });
    }
  });
  addEventListener("hashchange", () => {
    readAddress();
    draw();
  });
}

function start() {
  document.documentElement.classList.add("script");
  const compared = Boolean(find("th button[data-sort=change]", table));
  for (const button of findAll(".number, th button")) {
    button.disabled = button.dataset.outcome === "changed" && !compared;
  }
  listen();
  readAddress();
  draw();
}

if (table) {
  start();
}

"use strict";

// The page has the first rows as HTML and the facts of all rows, by which this script filters and
// sorts them.  The other rows are in files that are loaded as they are needed.  The table has
// elements only of the rows that are near the screen, and gaps as high as the rows that are not.

const table = document.getElementById("cases");
const poses = JSON.parse(document.getElementById("poses").textContent);
const EMPTY = { q: "", outcome: "", engine: "", family: "", sort: "", down: "" };
const state = { ...EMPTY };
const STEP = 60; // [ms] per pose
const RISING = ["name", "checked"]; // columns that are sorted in rising order first, others falling
const BEYOND = 800; // [px] above and below the screen, for which there are rows as well
const LOAD_PAUSE = 30; // [ms] between files of rows that are loaded in advance
const ROW_HEIGHT = 78; // [px] of a row before any has been drawn

// ---- Rows

// A row by the facts of the page; `html` and `element` are those of its row of the table.
function readRows({ shared, rows }) {
  return rows.name.map((name, k) => {
    const [title, family, words] = ["title", "family", "search"].map((key) => shared[rows[key][k]]);
    return {
      name,
      number: k,
      page: rows.page[k],
      title,
      family,
      symbol: shared[rows.symbol[k]],
      word: shared[rows.word[k]],
      state: shared[rows.state[k]],
      search: `${name} ${title} `.toLowerCase() + words,
      engines: shared[rows.engines[k]].split(" "),
      failing: shared[rows.failing[k]],
      checked: rows.channels[k] ? rows.checked[k] / rows.channels[k] : 0,
      gaps: rows.channels[k] - rows.checked[k],
      seconds: rows.seconds[k],
      changes: rows.changes[k],
      worse: rows.worse[k],
      values: Object.fromEntries(Object.entries(rows.values).map(([key, all]) => [key, all[k]])),
      element: null,
      whole: false,
      height: 0,
    };
  });
}

const facts = table ? JSON.parse(document.getElementById("facts").textContent) : null;
const rows = table ? readRows(facts) : [];
const perFile = table ? facts.per_file : 1;
const asked = new Set();
let chosen = []; // the rows that fit the filters, in their order

// The row of the table of a case: that of its file, and a short one until the file is there.
function elementOf(row) {
  if (!row.element) {
    row.element = document.createElement("tr");
    row.element.dataset.name = row.name;
    row.element.dataset.state = row.state;
    row.element.innerHTML =
      `<td class="state ${row.state}"><span aria-hidden="true">${escaped(row.symbol)}</span>` +
      `<span class="unseen">${escaped(row.word)}</span></td>` +
      `<td class="case"><a href="${escaped(row.page)}">${escaped(row.name)}</a>` +
      `<p>${escaped(row.title)}</p></td>`;
  }
  if (!row.whole) {
    load(Math.floor(row.number / perFile));
  }
  return row.element;
}

function load(number) {
  if (number > 0 && number * perFile < rows.length && !asked.has(number)) {
    asked.add(number);
    const script = document.createElement("script");
    script.src = `rows/${number}.js`;
    script.onload = script.onerror = () => script.remove();
    document.head.append(script);
  }
}

// Called by a file of rows, with its number, the HTML of its rows and the poses of their drawings.
function takeRows(number, texts, moving) {
  texts.forEach((text, k) => {
    const row = rows[number * perFile + k];
    const body = document.createElement("tbody");
    body.innerHTML = text;
    const before = row.element;
    const focused = before && before.contains(document.activeElement);
    Object.assign(row, { element: body.firstElementChild, whole: true, height: 0 });
    if (before) {
      before.replaceWith(row.element);
    }
    if (focused) {
      find("a", row.element).focus();
    }
    poses[row.name] = moving[k];
  });
  place();
}

// ---- Filters

const OUTCOMES = {
  agree: (row) => row.state === "good",
  differ: (row) => row.state === "bad",
  gaps: (row) => row.gaps > 0,
  changed: (row) => row.changes > 0,
};

function fits(row, words) {
  const { search, family, engines, failing } = row;
  if (!words.every((word) => search.includes(word))) {
    return false;
  }
  if (state.family && !(family === state.family || isFolder(family, state.family))) {
    return false;
  }
  if (state.engine && !engines.includes(state.engine)) {
    return false;
  }
  if (state.engine && state.outcome === "differ" && failing) {
    return failing.split(" ").includes(state.engine);
  }
  return !state.outcome || OUTCOMES[state.outcome](row);
}

function isFolder(family, wanted) {
  return wanted.endsWith("/") && family.startsWith(wanted);
}

// ---- Order

// The sort key of a row: the least comes first, unless the state is "down".
function sortValue(row, key) {
  if (key === "name") {
    return row.name;
  }
  if (key === "change") {
    return -(1000 * row.worse + row.changes);
  }
  if (key === "checked") {
    return row.checked;
  }
  if (key === "seconds") {
    return -row.seconds;
  }
  if (key) {
    const value = row.values[key];
    return value === null || value === undefined ? Infinity : -value;
  }
  return row.number;
}

function ordered(some) {
  const direction = state.down ? -1 : 1;
  const keyed = some.map((row) => [sortValue(row, state.sort), row.number, row]);
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
  chosen = ordered(rows.filter((row) => fits(row, words)));
  find("#none").hidden = chosen.length > 0;
  const cases = rows.length === 1 ? "case" : "cases";
  find("#count").textContent =
    chosen.length === rows.length
      ? `${chosen.length} ${cases}`
      : `${chosen.length} of ${rows.length} ${cases}`;
  table.setAttribute("aria-rowcount", findAll("thead tr", table).length + chosen.length);
  place();
  drawControls();
  keepAddress();
}

const printing = matchMedia("print");

// The heights of the chosen rows; of one that was never drawn it is the mean of those that were.
function heights() {
  const known = rows.filter((row) => row.height);
  const mean = known.length
    ? known.reduce((sum, row) => sum + row.height, 0) / known.length
    : ROW_HEIGHT;
  return chosen.map((row) => row.height || mean);
}

// The chosen rows that are near the screen, with their numbers in the order, and the one that has
// the focus, which would be lost with its row; all of them on paper.
function near(high) {
  if (printing.matches) {
    return chosen.map((_, k) => k);
  }
  const top = find("tbody", table).getBoundingClientRect().top;
  const found = [];
  let at = top;
  chosen.forEach((row, k) => {
    const seen = at + high[k] > -BEYOND && at < innerHeight + BEYOND;
    if (seen || (row.element && row.element.contains(document.activeElement))) {
      found.push(k);
    }
    at += high[k];
  });
  return found;
}

function gap(height) {
  const row = document.createElement("tr");
  row.className = "gap";
  row.setAttribute("aria-hidden", "true");
  row.style.height = `${height}px`;
  return row;
}

// Put the rows near the screen into the table, and gaps for the others.
function place(again = 2) {
  const high = heights();
  const wanted = [];
  let next = 0;
  const skip = (end) => {
    const height = high.slice(next, end).reduce((sum, each) => sum + each, 0);
    if (height > 0) {
      wanted.push(gap(height));
    }
  };
  const drawn = near(high);
  for (const k of drawn) {
    skip(k);
    const element = elementOf(chosen[k]);
    element.setAttribute("aria-rowindex", findAll("thead tr", table).length + k + 1);
    wanted.push(element);
    next = k + 1;
  }
  skip(chosen.length);
  fill(find("tbody", table), [...wanted, find("#none")]);
  hideColumns();
  const off = drawn.filter((k) => {
    const { height } = chosen[k].element.getBoundingClientRect();
    const changed = Math.abs(height - chosen[k].height) > 1;
    chosen[k].height = height;
    return changed;
  });
  if (off.length && again && !printing.matches) {
    place(again - 1); // the gaps and the rows near the screen depend on the heights
  }
}

// Give an element these children; those that stay are not moved, so that they keep the focus.
function fill(body, children) {
  const keep = new Set(children);
  for (const child of [...body.children]) {
    if (!keep.has(child)) {
      child.remove();
    }
  }
  children.forEach((child, k) => {
    if (body.children[k] !== child) {
      body.insertBefore(child, body.children[k] || null);
    }
  });
}

function hideColumns() {
  for (const cell of findAll("[data-of]", table)) {
    cell.hidden = Boolean(state.engine) && cell.dataset.of !== state.engine;
  }
}

let waiting = 0;

function placeSoon() {
  waiting = waiting || requestAnimationFrame(() => {
    waiting = 0;
    place();
  });
}

function forgetHeights() {
  for (const row of rows) {
    row.height = 0;
  }
  placeSoon();
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
  const option = find("#family").selectedOptions[0];
  const about = find("#about-family");
  about.textContent = option ? option.title : "";
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

// Whether the engine is one of the choices above the table; a single engine has none.
function hasChoice(engine) {
  return findAll("[data-engine]").some((button) => button.dataset.engine === engine);
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
  for (const button of findAll("[data-of-family]")) {
    const { ofFamily, ofEngine } = button.dataset;
    button.addEventListener("click", () => {
      change({ ...EMPTY, family: ofFamily, engine: hasChoice(ofEngine) ? ofEngine : "" });
      find(".bar").scrollIntoView();
    });
  }
  for (const button of findAll("[data-copy]")) {
    button.addEventListener("click", () => copyText(button.dataset.copy, button));
  }
  addEventListener("scroll", placeSoon, { passive: true });
  addEventListener("resize", forgetHeights);
  printing.addEventListener("change", () => place());
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
  for (const button of findAll(".number, th button, [data-of-family]")) {
    button.disabled = button.dataset.outcome === "changed" && !compared;
  }
  findAll("tbody tr[data-name]", table).forEach((element, k) => {
    Object.assign(rows[k], { element, whole: true });
  });
  listen();
  readAddress();
  draw();
  loadRest(1);
}

// Load the files of all rows one after the other, so that they are there when they are printed.
function loadRest(number) {
  if (number * perFile < rows.length) {
    load(number);
    setTimeout(() => loadRest(number + 1), LOAD_PAUSE);
  }
}

if (table) {
  start();
}

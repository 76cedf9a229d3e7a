// The trend of a case: errors of a channel over the last reports, and the error allowed now.
// The data and the looks of solvers are those of case.js.
"use strict";

const TREND = { left: 58, right: 18, top: 16, bottom: 30, height: 250, lane: 22 };
const NO_ERROR = -32768; // the integer for an error that a report does not have
const EXACT = -32767; // the integer for an error of zero, which has no logarithm
const FEW_DECADES = 6; // largest number of decades that are labelled

const trend = data.trend;
const trendState = { at: 0, report: trend.reports.length - 1 };
let hoveredReport = null;
let trendPlaces = null; // function across(k) of the chart that was drawn last

// ---- the data, decoded once

for (const row of trend.channels) {
  for (const one of Object.values(row.solvers)) {
    one.errors = [...unpacked(one.errors, "i2")].map((whole) =>
      whole === NO_ERROR ? null : whole === EXACT ? 0 : 10 ** (whole / trend.step),
    );
  }
}

const trendRow = () => trend.channels[trendState.at];
const runLabel = (row) => data.runs[row.run].label;
const comparisonNow = (row, solver) => data.runs[row.run].solvers[solver]?.comparisons[row.channel];
const lastOf = (errors) => errors.at(-1);

// The error allowed now, as a share of the range; null where nothing is checked.
function allowedNow(row, solver) {
  const c = comparisonNow(row, solver);
  return judged(c) ? c.allowed_share : null;
}

// The largest ratio of a solver's error to the error allowed now; null where none is checked.
function worstRatio(row) {
  const ratios = Object.keys(row.solvers)
    .map((solver) => comparisonNow(row, solver))
    .filter(judged)
    .map((c) => c.ratio ?? Infinity);
  return ratios.length ? Math.max(...ratios) : null;
}

// ---- words

const errorWords = (error) => (error === null ? "no error" : worded(error, 3));

function reportWords(k) {
  const report = trend.reports[k];
  const commit = report.commit ? `, commit ${report.commit}` : "";
  return `${report.day}${commit}${k === trend.reports.length - 1 ? ", this report" : ""}`;
}

function versionWords(k) {
  const versions = Object.entries(trend.versions[trend.reports[k].made]);
  return versions.map(([name, version]) => `${name} ${version}`).join(", ");
}

// The versions of a report that differ from those of the report before it.
function otherVersions(k) {
  if (!k || trend.reports[k].made === trend.reports[k - 1].made) {
    return "";
  }
  const [before, now] = [k - 1, k].map((one) => trend.versions[trend.reports[one].made]);
  const changed = [...new Set([...Object.keys(before), ...Object.keys(now)])]
    .filter((name) => before[name] !== now[name])
    .map((name) => `${name} ${before[name] ?? "unknown"} → ${now[name] ?? "unknown"}`);
  return changed.join(", ");
}

function solverWords(row, solver, k) {
  const error = row.solvers[solver].errors[k];
  const allowed = allowedNow(row, solver);
  const share = error !== null && allowed ? `, ${worded(error / allowed)} of what is allowed now` : "";
  return `${data.solvers[solver].label} ${errorWords(error)}${share}`;
}

// A report in words, for the pointer and for screen readers.
function toldReport(k) {
  const row = trendRow();
  const lines = Object.keys(row.solvers).map((solver) => {
    const { css, marker, dash } = data.solvers[solver];
    const [name, ...rest] = [data.solvers[solver].label, solverWords(row, solver, k)];
    const words = escaped(rest[0].slice(name.length));
    return `<p>${markerSign({ css, marker, dash })} <b class="${css} coloured">${escaped(name)}</b>${words}</p>`;
  });
  const versions = versionWords(k);
  const other = otherVersions(k);
  return (
    `<p><b>${escaped(reportWords(k))}</b></p>${lines.join("")}` +
    (versions ? `<p class="soft">${escaped(versions)}</p>` : "") +
    (other ? `<p>Other than in the report before: ${escaped(other)}</p>` : "")
  );
}

// The whole chart in words.
function trendWords(row) {
  const parts = Object.entries(row.solvers).map(([solver, { errors }]) => {
    const known = errors.filter((error) => error !== null);
    const allowed = allowedNow(row, solver);
    return (
      `${data.solvers[solver].label} from ${worded(known[0])} to ${errorWords(lastOf(errors))}, at most ` +
      `${worded(Math.max(...known))}${allowed ? `, allowed ${worded(allowed)}` : ", not checked"}`
    );
  });
  return `${row.channel}, ${runLabel(row)}, over ${trend.reports.length} reports: ${parts.join("; ")}`;
}

// ---- the chart

// The axis: [lowest, highest] decade of all errors and allowances, and whether any error is zero.
function trendAxis(row) {
  const errors = Object.values(row.solvers).flatMap((one) => one.errors);
  const allowed = Object.keys(row.solvers).map((solver) => allowedNow(row, solver));
  const logs = [...errors, ...allowed].filter((value) => value > 0).map(Math.log10);
  const low = Math.floor(Math.min(0, ...logs));
  const least = logs.length ? Math.floor(Math.min(...logs)) : low;
  const most = logs.length ? Math.ceil(Math.max(...logs) + 1e-9) : 0;
  return { low: least, high: Math.max(most, least + 1), zeros: errors.includes(0) };
}

function drawTrend() {
  const box = find("#trend-plot");
  const width = box.clientWidth;
  if (!width) {
    return;
  }
  const row = trendRow();
  const { low, high, zeros } = trendAxis(row);
  const count = trend.reports.length;
  const [right, base] = [width - TREND.right, TREND.height - TREND.bottom];
  const bottom = base - (zeros ? TREND.lane : 0);
  const across = (k) => TREND.left + (k / (count - 1)) * (right - TREND.left);
  const down = (error) =>
    error === 0
      ? base - 4
      : bottom - ((Math.log10(error) - low) / (high - low)) * (bottom - TREND.top);
  trendPlaces = { across, right };
  let drawing = "";
  const step = Math.max(1, Math.ceil((high - low) / FEW_DECADES));
  for (let decade = high; decade >= low; decade -= step) {
    const y = down(10 ** decade).toFixed(1);
    drawing += `<line class="gap-grid" x1="${TREND.left}" x2="${right}" y1="${y}" y2="${y}"/>`;
    drawing += `<text x="${TREND.left - 8}" y="${Number(y) + 4}" text-anchor="end">${worded(10 ** decade, 1)}</text>`;
  }
  if (zeros) {
    drawing += `<text x="${TREND.left - 8}" y="${base}" text-anchor="end">0</text>`;
  }
  for (const k of trend.reports.keys()) {
    if (otherVersions(k)) {
      const x = ((across(k) + across(k - 1)) / 2).toFixed(1);
      drawing += `<line class="trend-versions" x1="${x}" x2="${x}" y1="${TREND.top}" y2="${base}"/>`;
    }
  }
  drawing += dayLabels(across, width);
  drawing += allowances(row, down, right);
  drawing += `<line class="gap-now" y1="${TREND.top}" y2="${base}"/>`;
  for (const solver of Object.keys(row.solvers)) {
    drawing += trendLine(row, solver, across, down);
  }
  box.innerHTML =
    `<svg width="${width}" height="${TREND.height}" viewBox="0 0 ${width} ${TREND.height}" aria-hidden="true">` +
    `${drawing}</svg>`;
  tellReport();
}

// Days of the first and the last report, and as many between them as fit.
function dayLabels(across, width) {
  const last = trend.reports.length - 1;
  const room = Math.max(1, Math.floor((width - TREND.left) / 120));
  const every = Math.max(1, Math.ceil(last / room));
  const places = [...trend.reports.keys()].filter((k) => k % every === 0 && (k === 0 || last - k >= every));
  return [...places, last]
    .map((k) => {
      const side = k === last ? "end" : k === 0 ? "start" : "middle";
      const day = trend.reports[k].day.slice(0, 10);
      return `<text x="${(across(k) + (k === last ? TREND.right : 0)).toFixed(1)}" y="${TREND.height - 8}" text-anchor="${side}">${escaped(day)}</text>`;
    })
    .join("");
}

// The errors allowed now: a line for each value, with its solvers.
function allowances(row, down, right) {
  const solvers = Object.keys(row.solvers);
  const values = new Map();
  for (const solver of solvers) {
    const allowed = allowedNow(row, solver);
    if (allowed) {
      const words = worded(allowed, 2);
      values.set(words, { allowed, names: [...(values.get(words)?.names ?? []), solver] });
    }
  }
  return [...values]
    .map(([words, { allowed, names }], k) => {
      const [x, side] = k % 2 ? [right - 6, "end"] : [TREND.left + 6, "start"];
      const y = down(allowed);
      const whom = names.length < solvers.length ? ` (${names.map((name) => data.solvers[name].label).join(", ")})` : "";
      const text = escaped(`allowed now ${words}${whom}`);
      return (
        `<line class="trend-allowed" x1="${TREND.left}" x2="${right}" y1="${y.toFixed(1)}" y2="${y.toFixed(1)}"/>` +
        `<text class="trend-name" x="${x}" y="${(y - 4).toFixed(1)}" text-anchor="${side}">${text}</text>`
      );
    })
    .join("");
}

// Line and markers of a solver; markers are filled where the error is larger than allowed now.
function trendLine(row, solver, across, down) {
  const { css, dash, marker } = data.solvers[solver];
  const { errors } = row.solvers[solver];
  const allowed = allowedNow(row, solver);
  const steps = [...errors.entries()]
    .filter(([, error]) => error !== null)
    .map(([i, error]) => ({ i, error, at: `${across(i).toFixed(1)} ${down(error).toFixed(1)}` }));
  const missing = [...errors.keys()].filter((k) => errors[k] === null);
  const points = steps
    .map(({ i, error, at }) => {
      const over = allowed && error > allowed ? " over" : "";
      return `<path class="trend-point${over}" data-report="${i}" transform="translate(${at})" d="${marker}"/>`;
    })
    .join("");
  return (
    `<g class="${css}" data-solver="${escaped(solver)}">` +
    `<path class="trend-line" stroke-dasharray="${dash.join(" ")}" d="${strokes(steps, missing)}"/>${points}</g>`
  );
}

// Show the line and the text of the report under the pointer, or of the chosen one.
function tellReport() {
  const k = hoveredReport ?? trendState.report;
  const x = trendPlaces.across(k).toFixed(1);
  const line = find("#trend-plot .gap-now");
  line.setAttribute("x1", x);
  line.setAttribute("x2", x);
  for (const point of findAll("#trend-plot .trend-point")) {
    point.classList.toggle("here", Number(point.dataset.report) === k);
  }
  find("#trend-told").innerHTML = toldReport(k);
  const plot = find("#trend-plot");
  const chosen = trendState.report;
  plot.setAttribute("aria-valuenow", chosen + 1);
  const each = Object.keys(trendRow().solvers).map((solver) => solverWords(trendRow(), solver, chosen));
  plot.setAttribute("aria-valuetext", `${reportWords(chosen)}: ${each.join("; ")}`);
}

// ---- the list and the table

function drawTrendList() {
  const items = trend.channels.map((row, k) => {
    const ratio = worstRatio(row);
    const known = ratio !== null;
    const bad = known && ratio > 1;
    const [sign, words] = known ? (bad ? ["✗", "differs"] : ["✓", "agrees"]) : ["○", "not checked"];
    const [worst] = Object.values(row.solvers);
    const growth = Object.values(row.solvers).map((one) => one.growth).find(Boolean) ?? "";
    return (
      `<div class="item" role="option" id="trend-${k}" data-trend="${k}" aria-selected="${k === trendState.at}">` +
      `<span class="${known ? (bad ? "bad" : "ok") : "soft"}" role="img" aria-label="${words}">${sign}</span>` +
      `<span class="item-name" title="${escaped(row.channel)}">${escaped(row.channel)} <span class="soft">${escaped(runLabel(row))}</span></span>` +
      `<svg class="spark" viewBox="0 0 56 22" aria-hidden="true"><path d="${trendSpark(worst.errors)}"/></svg>` +
      `<span class="item-ratio ${bad ? "bad" : ""}">${known ? worded(ratio) : "–"}` +
      `${growth ? `<span class="growth">${escaped(growth)}</span>` : ""}</span></div>`
    );
  });
  find("#trend-list").innerHTML = items.join("");
  find("#trend-list").setAttribute("aria-activedescendant", `trend-${trendState.at}`);
  find("#trend-count").textContent = `${items.length} curve${items.length > 1 ? "s" : ""}`;
}

// Errors as a small logarithmic line, from a thousandth of the largest on.
function trendSpark(errors) {
  const most = Math.max(...errors.filter((error) => error !== null)) || 1;
  const logs = errors.map((error) => (error === null ? null : Math.log10(Math.max(error / most, 1e-3))));
  const missing = [...logs.keys()].filter((k) => logs[k] === null);
  const steps = [...logs.entries()]
    .filter(([, log]) => log !== null)
    .map(([i, log]) => ({
      i,
      at: `${((56 * i) / (errors.length - 1)).toFixed(1)} ${(3 - (16 / 3) * log).toFixed(1)}`,
    }));
  return strokes(steps, missing);
}

function drawTrendTable() {
  const row = trendRow();
  const solvers = Object.keys(row.solvers);
  const head = solvers.map((solver) => `<th scope="col">${escaped(data.solvers[solver].label)}</th>`);
  const lines = [...trend.reports.keys()].reverse().map((k) => {
    const cells = solvers.map((solver) => `<td>${escaped(worded(row.solvers[solver].errors[k], 3))}</td>`);
    return `<tr><th class="left-cell" scope="row">${escaped(reportWords(k))}</th>${cells.join("")}</tr>`;
  });
  find("#trend-table").innerHTML =
    `<caption>${escaped(row.channel)}, ${escaped(runLabel(row))}: largest error as a share of the range</caption>` +
    `<thead><tr><th class="left-cell" scope="col">report</th>${head.join("")}</tr></thead><tbody>${lines.join("")}</tbody>`;
}

// ---- events

function chooseTrend(k) {
  trendState.at = Math.min(Math.max(k, 0), trend.channels.length - 1);
  for (const item of findAll("#trend-list [role=option]")) {
    item.setAttribute("aria-selected", String(Number(item.dataset.trend) === trendState.at));
  }
  find("#trend-list").setAttribute("aria-activedescendant", `trend-${trendState.at}`);
  find(`#trend-${trendState.at}`).scrollIntoView({ block: "nearest" });
  showChannel();
}

function showChannel() {
  const row = trendRow();
  find("#trend-channel").textContent = row.channel;
  const other = trend.versions.length > 1 ? "; dotted: other versions from there on" : "";
  find("#trend-more").textContent =
    `${runLabel(row)}; share of the range, logarithmic; filled: beyond what is allowed now${other}`;
  find("#trend-plot").setAttribute("aria-label", trendWords(row));
  drawTrend();
  drawTrendTable();
}

function reportAt(event) {
  const box = find("#trend-plot").getBoundingClientRect();
  const share = (event.clientX - box.left - TREND.left) / (trendPlaces.right - TREND.left);
  return Math.min(Math.max(Math.round(share * (trend.reports.length - 1)), 0), trend.reports.length - 1);
}

function chooseReport(k) {
  trendState.report = Math.min(Math.max(k, 0), trend.reports.length - 1);
  hoveredReport = null;
  tellReport();
}

// Keys of the list and the chart, which are not passed on to the rest of the page.
function trendKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey) {
    return;
  }
  const inList = event.target.closest("#trend-list");
  const inPlot = event.target.closest("#trend-plot");
  const last = trend.reports.length - 1;
  const actions = {
    ArrowDown: (inList || inPlot) && (() => chooseTrend(trendState.at + 1)),
    ArrowUp: (inList || inPlot) && (() => chooseTrend(trendState.at - 1)),
    ArrowRight: (inList || inPlot) && (() => chooseReport(trendState.report + 1)),
    ArrowLeft: (inList || inPlot) && (() => chooseReport(trendState.report - 1)),
    Home: inPlot && (() => chooseReport(0)),
    End: inPlot && (() => chooseReport(last)),
  };
  if (actions[event.key]) {
    event.preventDefault();
    event.stopPropagation();
    actions[event.key]();
  }
}

function startTrend() {
  const box = find("#trend-body");
  box.hidden = false;
  drawTrendList();
  showChannel();
  find("#trend").addEventListener("keydown", trendKey);
  find("#trend").addEventListener("toggle", drawTrend);
  find("#trend-list").addEventListener("click", (event) => {
    const item = event.target.closest("[data-trend]");
    if (item) {
      chooseTrend(Number(item.dataset.trend));
    }
  });
  const plot = find("#trend-plot");
  plot.addEventListener("pointermove", (event) => {
    hoveredReport = reportAt(event);
    tellReport();
  });
  plot.addEventListener("pointerleave", () => {
    hoveredReport = null;
    tellReport();
  });
  plot.addEventListener("pointerdown", (event) => chooseReport(reportAt(event)));
  new ResizeObserver(drawTrend).observe(plot);
  if (openedAt === "#trend") {
    find("#trend").scrollIntoView();
  }
}

startTrend();

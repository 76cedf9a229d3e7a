// The chart of a stress study: every limit on the axis of its parameter.
"use strict";

const data = JSON.parse(find("#data").textContent);
const several = data.parts.length > 1;
const state = { case: several ? data.parts[0].stem : "", of: "" };

const ofCase = () => data.rows.filter((row) => !state.case || row.part === state.case);
const nameOf = new Map(data.parts.map((part) => [part.stem, part.name]));

// The rows that are shown, parameter by parameter.
function panels() {
  const shown = ofCase().filter((row) => (!state.of || row.panel === state.of) && isLeft(row.id));
  const titles = [...new Set(shown.map((row) => row.panel))];
  return titles.map((title) => {
    const rows = shown.filter((row) => row.panel === title);
    return {
      title,
      head: "limit",
      words: (value) => worded(value, 2),
      values: rows.flatMap((row) => [row.start, row.at, row.theory]),
      rows: rows.map((row) => ({
        ...row,
        label: state.case || !several || row.named ? row.label : `${nameOf.get(row.part)}: ${row.label}`,
        strip: (place) => stripOf(row, place),
      })),
    };
  });
}

// Where a parameter holds, where it fails, its limit and what theory says.
function stripOf(row, place) {
  if (!(row.at > 0)) {
    return "";
  }
  const at = place(row.at);
  const held = row.start === null ? "" : lineAt("held", place(row.start), at);
  const lost = row.found ? lineAt("lost", at, row.down ? 0 : 100) : "";
  const theory = row.theory === null ? "" : tickAt("theory", place(row.theory));
  return lost + held + theory + markAt(at, row.mark, row.silent ? "hollow" : "");
}

const chart = new RowChart(
  find("#rows"),
  "Limits",
  panels,
  (row) => showTableRow(row.id),
  () => "A click leads to the row of the table.",
);

// Show what the state says, and the parameters that there are to choose.
function show() {
  const titles = [...new Set(ofCase().map((row) => row.panel))];
  state.of = titles.includes(state.of) ? state.of : "";
  fillChoices(find("#panel"), "all", titles.map((title) => [title, title]));
  find("#panel").value = state.of;
  if (several) {
    find("#subject").value = state.case;
  }
  chart.draw();
}

function recall() {
  const address = readAddress();
  const anchor = decodeURIComponent(location.hash.slice(1));
  const asked = address.get("case") ?? anchor;
  if (nameOf.has(asked) && several) {
    state.case = asked;
  } else if (asked === "all") {
    state.case = "";
  }
  state.of = address.get("of") ?? state.of;
}

function keep() {
  const first = several ? data.parts[0].stem : "";
  keepInAddress({ case: state.case === first ? "" : state.case || "all", of: state.of });
}

function wire() {
  if (several) {
    fillChoices(find("#subject"), "all", data.parts.map((part) => [part.stem, part.name]));
  }
  for (const [id, key] of [
    ["#subject", "case"],
    ["#panel", "of"],
  ]) {
    find(id)?.addEventListener("change", (event) => {
      state[key] = event.target.value;
      show();
      keep();
    });
  }
  document.addEventListener("filtered", () => chart.draw());
  addEventListener("hashchange", () => {
    recall();
    show();
  });
}

find("#chart").hidden = false;
recall();
wire();
show();

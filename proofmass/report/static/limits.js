// The chart of a stress study: every limit on the axis of its parameter.
"use strict";

const data = JSON.parse(find("#data").textContent);
const subject = new Subject("case", data.parts);
const state = { of: "" };

const ofCase = () => data.rows.filter((row) => !subject.chosen || row.part === subject.chosen);
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
        label: subject.chosen || !subject.several || row.named ? row.label : `${nameOf.get(row.part)}: ${row.label}`,
        strip: (place) => stripOf(row, place),
      })),
    };
  });
}

// The strip of a limit: the range without failure, the range of failure, the limit, and theory.
function stripOf(row, place) {
  if (!(row.at > 0)) {
    return "";
  }
  const at = place(row.at);
  const held = row.start === null ? "" : lineAt("held", place(row.start), at);
  const failed = row.found ? lineAt("failed", at, row.down ? 0 : 100) : "";
  const theory = row.theory === null ? "" : tickAt("theory", place(row.theory));
  return failed + held + theory + markAt(at, row.mark, row.silent ? "hollow" : "");
}

const chart = new RowChart(
  find("#rows"),
  "Limits",
  panels,
  (row) => showTableRow(row.id),
  () => "A click leads to the row of the table.",
);

// Show the state, and the parameters that can be chosen.
function show() {
  const titles = [...new Set(ofCase().map((row) => row.panel))];
  state.of = titles.includes(state.of) ? state.of : "";
  fillChoices(find("#panel"), "all", titles.map((title) => [title, title]));
  find("#panel").value = state.of;
  subject.show();
  chart.draw();
}

function keep() {
  keepInAddress({ ...subject.kept, of: state.of });
}

find("#panel")?.addEventListener("change", (event) => {
  state.of = event.target.value;
  show();
  keep();
});
begin(chart, subject, {
  recall: (address) => {
    state.of = address.get("of") ?? state.of;
  },
  show,
  keep,
});

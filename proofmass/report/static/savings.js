// The chart of a diet: time of a step and memory with each feature, and without it.
"use strict";

const data = JSON.parse(find("#data").textContent);
const subject = new Subject("model", data.parts);
const COSTS = {
  seconds: { title: "time of a step", words: (value) => timeWords(value), told: "time" },
  memory: { title: "memory", words: (value) => `${worded(value, 2)} KB`, told: "kilobytes" },
};
const state = { cost: "seconds" };

// The saving: a share of the time, since the time of a step falls from trial to trial, or memory.
function savedBy(row) {
  const [before, after] = row[state.cost];
  return state.cost === "seconds" ? 1 - after / before : before - after;
}

// The visible rows, model by model: the whole first, then removed, removable and kept features.
function panels() {
  const shown = data.rows.filter((row) => (!subject.chosen || row.part === subject.chosen) && isLeft(row.id));
  return data.parts
    .map((part) => ({ part, rows: shown.filter((row) => row.part === part.stem) }))
    .filter(({ rows }) => rows.length)
    .map(({ part, rows }) => ({
      title: `${part.name}, ${COSTS[state.cost].title}`,
      head: "saves",
      words: COSTS[state.cost].words,
      values: rows.flatMap((row) => row[state.cost]),
      rows: rows
        .map((row) => ({
          ...row,
          value: row[COSTS[state.cost].told],
          strip: (place) => stripOf(row, place),
        }))
        .sort((one, two) => one.rank - two.rank || savedBy(two) - savedBy(one)),
    }));
}

// The strip of a row: from the cost with a feature to the cost without it, and its interval.
function stripOf(row, place) {
  const [before, after, low, high] = row[state.cost].map(place);
  const spread = low === undefined ? "" : lineAt("spread", low, high);
  const way = lineAt("bar", before, after);
  return way + spread + tickAt("theory", before) + markAt(after, row.mark, row.hollow ? "hollow" : "");
}

// Copy the edit of an option or a flag; for other edits scroll to the row of the table.
async function act(row) {
  if (!row.edit) {
    showTableRow(row.id);
    return "";
  }
  return (await copyText(row.edit)) ? `Copied: ${row.edit}` : `Not copied: ${row.edit}`;
}

const chart = new RowChart(find("#rows"), "Edits", panels, act, (row) =>
  row.edit ? `A click copies ${row.edit}` : "A click leads to the row of the table.",
);

function show() {
  for (const button of findAll("#costs button")) {
    button.setAttribute("aria-pressed", String(button.dataset.cost === state.cost));
  }
  subject.show();
  chart.draw();
}

function keep() {
  keepInAddress({ ...subject.kept, cost: state.cost === "seconds" ? "" : state.cost });
}

for (const button of findAll("#costs button")) {
  button.addEventListener("click", () => {
    state.cost = button.dataset.cost;
    show();
    keep();
  });
}
begin(chart, subject, {
  recall: (address) => {
    state.cost = address.get("cost") in COSTS ? address.get("cost") : state.cost;
  },
  show,
  keep,
});

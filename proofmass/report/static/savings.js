// The chart of a diet: what a step and the memory cost with each feature, and without.
"use strict";

const data = JSON.parse(find("#data").textContent);
const subject = new Subject("model", data.parts);
const COSTS = {
  seconds: { title: "time of a step", words: (value) => timeWords(value), told: "time" },
  memory: { title: "memory", words: (value) => `${worded(value, 2)} KB`, told: "kilobytes" },
};
const state = { cost: "seconds" };

// What is saved: of time a share, since what a step takes falls from trial to trial.
function savedBy(row) {
  const [before, after] = row[state.cost];
  return state.cost === "seconds" ? 1 - after / before : before - after;
}

// The rows that are shown, model by model: all together first, then what goes, could go and stays.
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

// From what it costs with a feature to what it costs without, and the interval of that.
function stripOf(row, place) {
  const [before, after, low, high] = row[state.cost].map(place);
  const spread = low === undefined ? "" : lineAt("spread", low, high);
  const way = lineAt("bar", before, after);
  return way + spread + tickAt("theory", before) + markAt(after, row.mark, row.hollow ? "hollow" : "");
}

// A click copies the edit of an option or a flag, and leads to the row of any other.
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

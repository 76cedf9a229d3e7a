// The chart of a diet: what a step and the memory cost with each feature, and without.
"use strict";

const data = JSON.parse(find("#data").textContent);
const several = data.parts.length > 1;
const COSTS = {
  seconds: { title: "time of a step", words: (value) => timeWords(value), told: "time" },
  memory: { title: "memory", words: (value) => `${worded(value, 2)} KB`, told: "kilobytes" },
};
const state = { model: several ? data.parts[0].stem : "", cost: "seconds" };

// What is saved: of time a share, since what a step takes falls from trial to trial.
function savedBy(row) {
  const [before, after] = row[state.cost];
  return state.cost === "seconds" ? 1 - after / before : before - after;
}

// The rows that are shown, model by model: all together first, then what goes, could go and stays.
function panels() {
  const shown = data.rows.filter((row) => (!state.model || row.part === state.model) && isLeft(row.id));
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
  if (several) {
    find("#subject").value = state.model;
  }
  chart.draw();
}

function recall() {
  const address = readAddress();
  const asked = address.get("model") ?? decodeURIComponent(location.hash.slice(1));
  if (several && data.parts.some((part) => part.stem === asked)) {
    state.model = asked;
  } else if (asked === "all") {
    state.model = "";
  }
  state.cost = address.get("cost") in COSTS ? address.get("cost") : state.cost;
}

function keep() {
  const first = several ? data.parts[0].stem : "";
  keepInAddress({
    model: state.model === first ? "" : state.model || "all",
    cost: state.cost === "seconds" ? "" : state.cost,
  });
}

function wire() {
  if (several) {
    fillChoices(find("#subject"), "all", data.parts.map((part) => [part.stem, part.name]));
  }
  find("#subject")?.addEventListener("change", (event) => {
    state.model = event.target.value;
    show();
    keep();
  });
  for (const button of findAll("#costs button")) {
    button.addEventListener("click", () => {
      state.cost = button.dataset.cost;
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

// Functions of all pages of studies: buttons that copy, tables that sort, rows with filters.
"use strict";

function wireCopies(inside = document) {
  for (const button of findAll("[data-copy]", inside)) {
    button.hidden = false;
    button.addEventListener("click", () => {
      copyText(find("pre", button.parentElement).textContent, button);
    });
  }
}

// The value of a cell to sort by: its number if it has one, otherwise its words.
function sortValue(cell) {
  if (!cell) {
    return "";
  }
  const given = cell.dataset.value;
  if (given === undefined) {
    return cell.textContent.trim().toLowerCase();
  }
  return given === "" ? Number.NaN : Number(given);
}

// Compare cells: numbers before words, and empty cells last in either direction.
function compareValues(one, two, sign) {
  const missing = [one, two].map((value) => value === "" || Number.isNaN(value));
  if (missing[0] || missing[1]) {
    return missing[0] - missing[1];
  }
  if (typeof one === "number" && typeof two === "number") {
    return sign * (one - two);
  }
  return sign * String(one).localeCompare(String(two), "en", { numeric: true });
}

// Put a button into each heading that says so; it sorts the rows of the table.
function wireSorting() {
  for (const heading of findAll("th[data-sort]")) {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...heading.childNodes);
    heading.append(button);
    button.addEventListener("click", () => sortTable(heading));
  }
}

function sortTable(heading) {
  const table = heading.closest("table");
  const column = [...heading.parentElement.children].indexOf(heading);
  const rising = heading.getAttribute("aria-sort") !== "ascending";
  for (const other of findAll("th[aria-sort]", table)) {
    other.removeAttribute("aria-sort");
  }
  heading.setAttribute("aria-sort", rising ? "ascending" : "descending");
  const body = find("tbody", table);
  const rows = [...body.rows].map((row) => [sortValue(row.cells[column]), row]);
  rows.sort((one, two) => compareValues(one[0], two[0], rising ? 1 : -1));
  body.append(...rows.map(([, row]) => row));
}

// The parts of the address after #, such as key=value, separated by semicolons.
function readAddress() {
  const parts = decodeURIComponent(location.hash.slice(1)).split(";");
  const found = new Map();
  for (const part of parts) {
    const [key, ...value] = part.split("=");
    if (key && value.length) {
      found.set(key, value.join("="));
    }
  }
  return found;
}

function writeAddress(values) {
  const parts = Object.entries(values).filter(([, value]) => value);
  const text = parts.map(([key, value]) => `${key}=${encodeURI(value)}`).join(";");
  history.replaceState(null, "", text ? `#${text}` : location.pathname + location.search);
}

// Keep some parts of the address, and leave the others as they are.
function keepInAddress(values) {
  writeAddress({ ...Object.fromEntries(readAddress()), ...values });
}

// Rows with data-group are shown if no filter excludes them; filters are buttons and a search.
function wireFilters() {
  const box = find("#filters");
  if (!box) {
    return;
  }
  const search = find("input", box);
  const buttons = findAll("button[data-group]", box);
  const rows = findAll("tr[data-groups]");
  const count = find("output", box);
  const apply = (keep) => {
    const off = buttons.filter((one) => one.getAttribute("aria-pressed") === "false");
    const hidden = new Set(off.map((one) => one.dataset.group));
    const words = search.value.trim().toLowerCase().split(/\s+/);
    let shown = 0;
    for (const row of rows) {
      const groups = row.dataset.groups.split("|");
      const text = row.textContent.toLowerCase();
      row.hidden = groups.some((one) => hidden.has(one)) || !words.every((one) => text.includes(one));
      shown += row.hidden ? 0 : 1;
    }
    for (const part of findAll(".part")) {
      const own = findAll("tr[data-groups]", part);
      part.hidden = own.length > 0 && own.every((row) => row.hidden);
    }
    count.textContent = `${shown} of ${rows.length} rows`;
    if (keep) {
      keepInAddress({ off: [...hidden].join(","), find: search.value.trim() });
    }
    document.dispatchEvent(new Event("filtered"));
  };
  for (const button of buttons) {
    button.addEventListener("click", () => {
      const on = button.getAttribute("aria-pressed") === "true";
      button.setAttribute("aria-pressed", String(!on));
      apply(true);
    });
  }
  search.addEventListener("input", () => apply(true));
  const address = readAddress();
  const off = (address.get("off") ?? "").split(",");
  for (const button of buttons) {
    button.setAttribute("aria-pressed", String(!off.includes(button.dataset.group)));
  }
  search.value = address.get("find") ?? "";
  box.hidden = false;
  apply(false);
  document.addEventListener("keydown", (event) => {
    if (event.key === "/" && !event.target.closest("input")) {
      event.preventDefault();
      search.focus();
    }
  });
}

// Open closed tables for printing.
function openForPrint() {
  let opened = [];
  addEventListener("beforeprint", () => {
    opened = findAll("details:not([open])");
    for (const one of opened) {
      one.open = true;
    }
  });
  addEventListener("afterprint", () => {
    for (const one of opened) {
      one.open = false;
    }
  });
}

wireCopies();
openForPrint();
wireSorting();
wireFilters();

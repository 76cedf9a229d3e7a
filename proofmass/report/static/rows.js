// A chart of rows in panels, each panel on an axis of its own: drawing, pointer and keyboard.
"use strict";

const ROOM = 0.06; // of the decades of an axis: margin at both ends
const NARROW = 620; // [px] charts that are narrower have fewer labels on their axes

// The axis of some values: from place 0 to 100 per cent, and its ticks.
function axisOf(values, most) {
  const logs = values.filter((value) => value > 0).map(Math.log10);
  let [low, high] = logs.length ? [Math.min(...logs), Math.max(...logs)] : [-1, 1];
  const room = Math.max(ROOM * (high - low), 0.04);
  [low, high] = [10 ** (low - room), 10 ** (high + room)];
  return { ...scale(low, high, 0, 100), ticks: ticks(low, high, most) };
}

// A marker at a place of a strip.
const markAt = (place, path, name = "") =>
  `<svg x="${place.toFixed(2)}%" y="50%" overflow="visible"><path class="dot ${name}" d="${path}"/></svg>`;

const lineAt = (name, from, to) =>
  `<line class="${name}" x1="${from.toFixed(2)}%" x2="${to.toFixed(2)}%" y1="50%" y2="50%"/>`;

const tickAt = (name, place) =>
  `<line class="${name}" x1="${place.toFixed(2)}%" x2="${place.toFixed(2)}%" y1="1" y2="21"/>`;

class RowChart {
  // `panels()` returns the panels: { title, head (of the values), values (for the axis), words(value), rows }; a
  // row has id, label, value, said, css and strip(place), which draws it.  `act(row)` is called by a click or Enter,
  // `hint(row)` describes it.
  constructor(box, name, panels, act, hint) {
    Object.assign(this, { box, name, panels, act, hint, rows: new Map(), at: null });
    this.list = document.createElement("div");
    this.list.className = "row-list";
    this.list.tabIndex = 0;
    this.list.setAttribute("role", "listbox");
    this.list.setAttribute("aria-label", name);
    this.tip = document.createElement("div");
    this.tip.className = "tip";
    this.tip.hidden = true;
    this.status = document.createElement("span");
    this.status.className = "unseen";
    this.status.setAttribute("role", "status");
    box.append(this.list, this.tip, this.status);
    this.wire();
  }

  draw() {
    const most = this.list.clientWidth < NARROW ? 3 : 6;
    const panels = this.panels();
    this.rows = new Map(panels.flatMap((panel) => panel.rows.map((row) => [row.id, row])));
    this.list.innerHTML = panels.map((panel) => this.panel(panel, axisOf(panel.values, most))).join("");
    const count = this.rows.size;
    this.list.setAttribute("aria-label", `${this.name}: ${count} row${count === 1 ? "" : "s"}`);
    if (!this.rows.has(this.at)) {
      this.at = null;
    }
    this.choose(this.at, false);
    this.tell(null);
  }

  panel({ title, head, rows, words }, axis) {
    const grid = axis.ticks
      .map((value) => `<line class="grid" x1="${axis.place(value).toFixed(2)}%" x2="${axis.place(value).toFixed(2)}%" y1="0" y2="100%"/>`)
      .join("");
    const labels = axis.ticks.map((value) => {
      const place = axis.place(value);
      const side = place < 6 ? "start" : place > 94 ? "end" : "middle";
      return `<text x="${place.toFixed(2)}%" y="13" text-anchor="${side}">${escaped(words(value))}</text>`;
    });
    const lines = rows.map(
      (row) =>
        `<div class="row ${row.css}" role="option" id="row-${escaped(row.id)}" data-row="${escaped(row.id)}" aria-selected="false"` +
        ` aria-label="${escaped(`${row.label}, ${title}. ${row.said}`)}">` +
        `<span class="row-label${row.strong ? " strong" : ""}">${escaped(row.label)}</span>` +
        `<svg class="strip" height="22" aria-hidden="true">${grid}${row.strip(axis.place)}</svg>` +
        `<span class="row-value">${escaped(row.value)}</span></div>`,
    );
    return (
      `<div role="group" aria-label="${escaped(title)}">` +
      `<div class="row-head" aria-hidden="true"><b>${escaped(title)}</b><svg class="strip" height="18">${labels.join("")}</svg><span class="row-value soft">${escaped(head)}</span></div>` +
      `${lines.join("")}</div>`
    );
  }

  option(id) {
    return id === null ? null : document.getElementById(`row-${id}`);
  }

  // Mark a row as chosen; with `show` it is scrolled into view and its text is shown.
  choose(id, show = true) {
    this.option(this.at)?.setAttribute("aria-selected", "false");
    this.at = id;
    const option = this.option(id);
    if (!option) {
      this.list.removeAttribute("aria-activedescendant");
      return;
    }
    option.setAttribute("aria-selected", "true");
    this.list.setAttribute("aria-activedescendant", option.id);
    if (show) {
      option.scrollIntoView({ block: "nearest" });
      this.tell(id);
    }
  }

  // Show the text of a row beside it; without a row, hide it.
  tell(id, done = "") {
    const row = this.rows.get(id);
    this.tip.hidden = !row;
    if (!row) {
      return;
    }
    this.tip.className = `tip ${row.css}`;
    this.tip.innerHTML =
      `<b>${escaped(row.label)}</b><br>${escaped(row.said)}` +
      `<br><span class="soft">${escaped(done || this.hint(row))}</span>`;
    const [frame, line] = [this.box, this.option(id)].map((one) => one.getBoundingClientRect());
    const below = line.bottom - frame.top + 4;
    const above = line.top - frame.top - this.tip.offsetHeight - 4;
    const left = Math.max(8, Math.min(frame.width * 0.34, frame.width - this.tip.offsetWidth - 8));
    this.tip.style.left = `${left}px`;
    this.tip.style.top = `${below + this.tip.offsetHeight > frame.height && above > 0 ? above : below}px`;
  }

  async done(id) {
    const row = this.rows.get(id);
    if (row) {
      const words = await this.act(row);
      if (words) {
        this.list.focus({ preventScroll: true }); // copying may have moved the focus
        this.status.textContent = words;
        this.tell(id, words);
      }
    }
  }

  wire() {
    const idOf = (event) => event.target.closest("[data-row]")?.dataset.row ?? null;
    const focused = () => (document.activeElement === this.list ? this.at : null);
    this.list.addEventListener("pointermove", (event) => {
      const id = idOf(event);
      if (id !== this.hovered) {
        this.hovered = id;
        this.tell(id ?? focused());
      }
    });
    this.list.addEventListener("pointerleave", () => {
      this.hovered = null;
      this.tell(focused());
    });
    this.list.addEventListener("scroll", () => this.tell(this.hovered ?? null));
    this.list.addEventListener("click", (event) => {
      const id = idOf(event);
      if (id !== null) {
        this.choose(id, false);
        this.done(id);
      }
    });
    this.list.addEventListener("focus", () => {
      if (this.list.matches(":focus-visible")) {
        this.choose(this.at ?? this.rows.keys().next().value ?? null);
      }
    });
    this.list.addEventListener("blur", () => this.tell(null));
    this.list.addEventListener("keydown", (event) => this.pressed(event));
    let wide = this.list.clientWidth < NARROW;
    new ResizeObserver(() => {
      if (this.list.clientWidth < NARROW !== wide) {
        wide = this.list.clientWidth < NARROW;
        this.draw();
      }
    }).observe(this.list);
  }

  pressed(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) {
      return;
    }
    const ids = [...this.rows.keys()];
    const k = ids.indexOf(this.at);
    const next = {
      ArrowDown: Math.min(k + 1, ids.length - 1),
      ArrowUp: Math.max(k - 1, 0),
      Home: 0,
      End: ids.length - 1,
    }[event.key];
    if (next !== undefined && ids.length) {
      event.preventDefault();
      this.choose(ids[next]);
    } else if ((event.key === "Enter" || event.key === " ") && this.at !== null) {
      event.preventDefault();
      this.done(this.at);
    } else if (event.key === "Escape") {
      this.tell(null);
    }
  }
}

// Scroll to a row of a table, which is marked until another one is.
function showTableRow(id) {
  const row = document.getElementById(id);
  for (const other of findAll("tr.led-to")) {
    other.classList.remove("led-to");
  }
  row.classList.add("led-to");
  const heading = find("th", row);
  heading.tabIndex = -1;
  heading.focus({ preventScroll: true });
  row.scrollIntoView({ block: "center" });
}

// Whether the filters show the row of a table.
const isLeft = (id) => !document.getElementById(id)?.hidden;

// Fill a list of choices; the first choice is all of them.
function fillChoices(select, all, choices) {
  select.replaceChildren(
    ...[["", all], ...choices].map(([value, words]) => new Option(words, value)),
  );
}

// The subject of a study's chart: one part of the study or all of them (""), by a list of choices and the address.
class Subject {
  constructor(key, parts) {
    Object.assign(this, { key, parts, several: parts.length > 1 });
    this.first = this.several ? parts[0].stem : "";
    this.chosen = this.first;
    if (this.several) {
      fillChoices(find("#subject"), "all", parts.map((part) => [part.stem, part.name]));
    }
  }

  recall(address) {
    const asked = address.get(this.key) ?? decodeURIComponent(location.hash.slice(1));
    if (this.several && this.parts.some((part) => part.stem === asked)) {
      this.chosen = asked;
    } else if (asked === "all") {
      this.chosen = "";
    }
  }

  show() {
    if (this.several) {
      find("#subject").value = this.chosen;
    }
  }

  // The parts of the address that store it.
  get kept() {
    return { [this.key]: this.chosen === this.first ? "" : this.chosen || "all" };
  }
}

// Show a chart by the address, and again when its subject, the filters or the address change.
function begin(chart, subject, { recall, show, keep }) {
  const recallAll = () => {
    const address = readAddress();
    subject.recall(address);
    recall(address);
  };
  find("#chart").hidden = false;
  find("#subject")?.addEventListener("change", (event) => {
    subject.chosen = event.target.value;
    show();
    keep();
  });
  document.addEventListener("filtered", () => chart.draw());
  addEventListener("hashchange", () => {
    recallAll();
    show();
  });
  recallAll();
  show();
}

"use strict";
// Tables (list.js), the rerun dialog, copy buttons and histograms (Chartist). Text of submissions is
// only written as textContent.

const NUMERIC = ["rank", "success", "stages", "score", "n", "steps", "seconds", "seed", "id", "return"];

function pageData() {
  const block = document.getElementById("data");
  return block ? JSON.parse(block.textContent) : null;
}

function compareBy(key) {
  const numeric = NUMERIC.includes(key);
  return (a, b) => {
    const [x, y] = [a.values()[key], b.values()[key]];
    return numeric ? Number(x) - Number(y) : x.localeCompare(y, "en", { numeric: true });
  };
}

// A table with search, filters and sorting. `state` is kept in the address, so that views can be shared.
class FilteredTable {
  constructor(root, columns, options) {
    this.root = root;
    this.options = options;
    this.list = new List(root, { listClass: "list", valueNames: [{ data: [...columns, "words"] }] });
    this.selects = [...root.querySelectorAll("select[data-filter]")];
    this.search = root.querySelector("input[type=search]");
    this.order = options.order;
    this.selects.forEach((select) => select.addEventListener("change", () => this.update()));
    this.search.addEventListener("input", () => this.update());
    root.querySelectorAll("[data-sort-by]").forEach((button) => {
      button.addEventListener("click", () => this.sortBy(button.dataset.sortBy));
    });
  }

  sortBy(key) {
    const [current, direction] = this.order.split(":");
    const first = (this.options.descending || []).includes(key) ? "desc" : "asc";
    const opposite = direction === "asc" ? "desc" : "asc";
    this.order = `${key}:${current === key ? opposite : first}`;
    this.update();
  }

  matches(values) {
    const words = this.search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const text = values.words.toLowerCase();
    if (!words.every((word) => text.includes(word))) return false;
    return this.selects.every((select) => {
      const value = values[select.dataset.filter];
      const several = select.dataset.filter === "kind";
      if (!select.value) return true;
      return several ? value.split(" ").includes(select.value) : value === select.value;
    });
  }

  update() {
    const [key, order] = this.order.split(":");
    this.list.filter((item) => this.matches(item.values()));
    this.list.sort(key, { order, sortFunction: compareBy(key) });
    this.root.querySelectorAll("th[data-column]").forEach((head) => {
      const sorted = head.dataset.column === key;
      if (sorted) head.setAttribute("aria-sort", order === "asc" ? "ascending" : "descending");
      else head.removeAttribute("aria-sort");
    });
    if (this.options.onUpdate) this.options.onUpdate(this);
  }
}

function readAddress(table, sortSelect) {
  const wanted = new URLSearchParams(location.hash.slice(1));
  table.search.value = wanted.get("q") || "";
  table.selects.forEach((select) => {
    const value = wanted.get(select.dataset.filter) || "";
    const known = [...select.options].some((option) => option.value === value);
    select.value = known ? value : "";
  });
  const order = wanted.get("sort") || "";
  const columns = [...sortSelect.options].map((option) => option.value.split(":")[0]);
  const [key, direction] = order.split(":");
  const valid = [...columns, "seed", "env", "scenes", "stages", "score"].includes(key);
  table.order = valid && ["asc", "desc"].includes(direction) ? order : "rank:asc";
}

function writeAddress(table) {
  const found = new URLSearchParams();
  if (table.search.value) found.set("q", table.search.value);
  table.selects.forEach((select) => {
    if (select.value) found.set(select.dataset.filter, select.value);
  });
  if (table.order !== "rank:asc") found.set("sort", table.order);
  const hash = found.toString();
  history.replaceState(null, "", hash ? `#${hash}` : location.pathname + location.search);
}

function startLeaderboard(root) {
  const sortSelect = document.getElementById("sort-select");
  const columns = ["rank", "agent", "env", "scenes", "split", "kind", "privileged", "targets", "success"];
  columns.push("stages", "score", "n", "steps", "seconds", "seed");
  const table = new FilteredTable(root, columns, {
    order: "rank:asc",
    descending: ["success", "n", "stages", "score"],
    onUpdate: (shown) => {
      const count = shown.list.matchingItems.length;
      document.getElementById("count").textContent = `${count} of ${shown.list.size()} runs`;
      document.getElementById("nothing").hidden = count > 0;
      const known = [...sortSelect.options].some((option) => option.value === shown.order);
      if (known) sortSelect.value = shown.order;
      writeAddress(shown);
    },
  });
  sortSelect.addEventListener("change", () => {
    table.order = sortSelect.value;
    table.update();
  });
  document.getElementById("reset").addEventListener("click", () => {
    table.search.value = "";
    table.selects.forEach((select) => (select.value = ""));
    table.order = "rank:asc";
    table.update();
  });
  window.addEventListener("hashchange", () => {
    readAddress(table, sortSelect);
    table.update();
  });
  readAddress(table, sortSelect);
  table.update();
  startReruns(root);
}

function commandLine(text) {
  const line = document.createElement("div");
  line.className = "command";
  const code = document.createElement("code");
  text.split(" ").forEach((word, index) => {
    const part = document.createElement("span"); // lines break between words only
    part.textContent = word;
    code.append(index ? " " : "", part);
  });
  const button = document.createElement("button");
  button.type = "button";
  button.className = "copy";
  button.dataset.copy = text;
  button.textContent = "Copy";
  button.setAttribute("aria-label", `Copy: ${text.slice(0, 60)}`);
  line.append(code, button);
  return line;
}

function fact([name, value]) {
  const row = document.createElement("div");
  const term = document.createElement("dt");
  const description = document.createElement("dd");
  term.textContent = name;
  description.textContent = value;
  row.append(term, description);
  return row;
}

function startReruns(root) {
  const data = pageData();
  const dialog = document.getElementById("rerun");
  root.addEventListener("click", (event) => {
    const button = event.target.closest("button.rerun");
    if (!button) return;
    const { slug } = button.dataset;
    const run = data[slug];
    document.getElementById("rerun-title").textContent = button.getAttribute("aria-label");
    document.getElementById("rerun-commands").replaceChildren(...run.commands.map(commandLine));
    document.getElementById("rerun-verify").replaceChildren(commandLine(run.verify));
    document.getElementById("rerun-note").textContent = run.note;
    document.getElementById("rerun-facts").replaceChildren(...run.facts.map(fact));
    document.getElementById("rerun-link").href = `runs/${slug}.html`;
    dialog.showModal();
  });
  dialog.addEventListener("click", (event) => {
    if (event.target === dialog) dialog.close(); // a click beside the dialog
  });
}

async function copyText(text) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    const area = document.createElement("textarea"); // without permission for the clipboard
    area.value = text;
    (document.querySelector("dialog[open]") || document.body).append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
}

function startCopying() {
  document.addEventListener("click", async (event) => {
    const button = event.target.closest("button.copy");
    if (!button) return;
    await copyText(button.dataset.copy);
    button.textContent = "Copied";
    setTimeout(() => (button.textContent = "Copy"), 1500);
  });
}

function shortNumber(value) {
  return Math.abs(value) >= 100 ? value.toFixed(0) : Number(value.toPrecision(2)).toString();
}

function drawHistogram(id, histogram) {
  const every = Math.ceil(histogram.success.length / 5);
  const labels = histogram.edges.slice(0, -1).map(shortNumber);
  const data = { labels, series: [histogram.success, histogram.failure] };
  new Chartist.BarChart(document.getElementById(id), data, {
    stackBars: true,
    height: 180,
    chartPadding: { top: 14, right: 8, bottom: 0, left: 0 },
    axisX: {
      showGrid: false,
      labelInterpolationFnc: (label, index) => (index % every === 0 ? label : null),
    },
    axisY: { onlyInteger: true, offset: 32 },
  });
}

function startRun(root) {
  const columns = ["id", "scene", "outcome", "steps", "return", "seconds"];
  new FilteredTable(root, columns, { order: "id:asc" }).update();
  const data = pageData();
  drawHistogram("return-chart", data.return);
  drawHistogram("steps-chart", data.steps);
}

const board = document.getElementById("board");
const episodeTable = document.getElementById("episode-table");
startCopying();
if (board) startLeaderboard(board);
if (episodeTable) startRun(episodeTable);

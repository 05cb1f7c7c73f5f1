"use strict";
// Paired comparison of two runs. Text of submissions is only written as textContent.

const data = JSON.parse(document.getElementById("data").textContent);
const selects = ["first", "second"].map((id) => document.getElementById(id));

function show(id, text) {
  document.getElementById(id).textContent = text;
}

// [n, both, only the first, only the second, p] for two runs in either order.
function pairOf(first, second) {
  for (const [a, b, n, both, onlyA, onlyB, p] of data.pairs) {
    if (a === first && b === second) return [n, both, onlyA, onlyB, p];
    if (a === second && b === first) return [n, both, onlyB, onlyA, p];
  }
  return null;
}

function shownP(p) {
  return p < 0.0001 ? "< 0.0001" : p.toFixed(4);
}

function cell(text, name) {
  const found = document.createElement("td");
  if (name) found.className = name;
  found.textContent = text;
  return found;
}

function outcomeCell(run, episode) {
  const found = cell("");
  const mark = document.createElement("span");
  mark.className = `outcome ${run.outcome[episode] === 0 ? "ok" : "bad"}`;
  mark.textContent = run.outcomes[run.outcome[episode]];
  found.append(mark);
  return found;
}

function differenceRows(a, b) {
  const rows = [];
  data.episodes.forEach((id, episode) => {
    const known = a.outcome[episode] !== null && b.outcome[episode] !== null;
    if (!known || (a.outcome[episode] === 0) === (b.outcome[episode] === 0)) return;
    const row = document.createElement("tr");
    const head = document.createElement("th");
    head.scope = "row";
    head.textContent = id;
    row.append(head, cell(data.scenes[episode]));
    for (const run of [a, b]) row.append(outcomeCell(run, episode), cell(run.steps[episode], "num"));
    rows.push(row);
  });
  return rows;
}

function sentence(n, onlyFirst, onlySecond) {
  const difference = (100 * (onlyFirst - onlySecond)) / n;
  const sign = difference > 0 ? "+" : "";
  return (
    `${onlyFirst + onlySecond} of ${n} common episodes have different outcomes: ${onlyFirst} are solved only by ` +
    `the first run, ${onlySecond} only by the second (difference ${sign}${difference.toFixed(1)} points).`
  );
}

function update() {
  const [first, second] = selects.map((select) => Number(select.value));
  const pair = pairOf(first, second);
  const runs = [data.runs[first], data.runs[second]];
  history.replaceState(null, "", `#${runs[0].slug}&${runs[1].slug}`);
  document.getElementById("first-link").href = `../runs/${runs[0].slug}.html`;
  document.getElementById("second-link").href = `../runs/${runs[1].slug}.html`;
  const ids = ["both", "only-first", "only-second", "neither", "p-value"];
  if (!pair) {
    show("verdict", first === second ? "Choose two different runs." : "These runs have no common episodes.");
    ids.forEach((id) => show(id, "–"));
    document.getElementById("differences").replaceChildren();
    return;
  }
  const [n, both, onlyFirst, onlySecond, p] = pair;
  show("verdict", sentence(n, onlyFirst, onlySecond));
  const values = [both, onlyFirst, onlySecond, n - both - onlyFirst - onlySecond, shownP(p)];
  ids.forEach((id, index) => show(id, values[index]));
  const rows = differenceRows(...runs);
  if (!rows.length) {
    const none = document.createElement("tr");
    const only = cell("No episode has different outcomes.");
    only.colSpan = 6;
    none.append(only);
    rows.push(none);
  }
  document.getElementById("differences").replaceChildren(...rows);
}

function readAddress() {
  const slugs = location.hash.slice(1).split("&");
  const wanted = slugs.map((slug) => data.runs.findIndex((run) => run.slug === slug));
  selects.forEach((select, side) => {
    const [first, second] = data.pairs[0];
    select.value = String(wanted[side] >= 0 ? wanted[side] : [first, second][side]);
  });
}

selects.forEach((select) => select.addEventListener("change", update));
window.addEventListener("hashchange", () => {
  readAddress();
  update();
});
readAddress();
update();

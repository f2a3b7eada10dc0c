"use strict";
// The data page: list of recordings, scrubber, suspicious moments, ranges that are left out.

const NEAR_SECONDS = 10; // of the lower chart, before and behind the current row
const POLL_MS = 1500; // while recordings are being examined

const byId = (id) => document.getElementById(id);
let list = [];
let chosen = 0; // number of the recording
let data = null; // its series
let moments = [];
let row = 0;
let range = null; // first and last row
let playing = null; // timer

async function fetched(path) {
  return (await fetch(path)).json();
}

async function refresh() {
  const answer = await fetched("recordings").catch(() => null);
  if (!answer) {
    byId("state").textContent = "no connection to inspect_data.py";
    setTimeout(refresh, POLL_MS);
    return;
  }
  const before = JSON.stringify(list[chosen] ?? null);
  list = answer.recordings;
  byId("model").textContent = byId("model-line").textContent = answer.model ? `steering of ${answer.model}` : "";
  showList();
  const busy = list.find((each) => each.state && each.state !== "waiting");
  byId("state").textContent = busy ? `${busy.name}: ${busy.state}` : "";
  if (!data) await choose(0);
  else if (before !== JSON.stringify(list[chosen])) await load();
  if (list.some((each) => each.state)) setTimeout(refresh, POLL_MS);
}

function showList() {
  byId("recordings").replaceChildren(...list.map((each, number) => {
    const line = document.createElement("tr");
    line.className = number === chosen ? "chosen" : "";
    line.title = each.folder;
    const left = Object.entries(each.left_out).map(([reason, count]) => `${reason}: ${count}`).join(", ");
    const percent = (share) => `${(100 * share).toFixed(0)} %`;
    const track = each.track ? `${each.track} (${each.correlation.toFixed(2)})` : "unknown";
    const cells = [each.name, each.minutes.toFixed(1), each.rows, each.hz, each.mph ?? "–", track, percent(each.zeros), percent(each.full_lock), "", left || "–", each.moments];
    for (const cell of cells) line.insertCell().textContent = cell;
    const histogram = document.createElement("canvas");
    histogram.className = "histogram";
    line.cells[8].append(histogram);
    requestAnimationFrame(() => drawHistogram(histogram, each.histogram));
    line.addEventListener("click", () => choose(number));
    return line;
  }));
}

async function choose(number) {
  chosen = number;
  row = 0;
  range = null;
  stop();
  showList();
  await load();
}

async function load() {
  const number = chosen;
  const [series, found] = await Promise.all([fetched(`recordings/${number}/series`), fetched(`recordings/${number}/moments`)]);
  if (number !== chosen) return;
  data = series;
  moments = found.moments;
  byId("row").max = data.time.length - 1;
  const track = list[chosen].track;
  byId("place").textContent = track ? `${track}, found by the path's curvature` : "unknown track: dead reckoning";
  for (const camera of ["left", "right"]) byId(camera).hidden = !data.cameras.includes(camera);
  showMoments();
  go(row);
}

function showMoments() {
  byId("moments").replaceChildren(...moments.map((moment) => {
    const line = document.createElement("tr");
    for (const cell of [moment.seconds.toFixed(1), `${moment.first}–${moment.last}`, moment.reason, moment.score.toFixed(1)]) {
      line.insertCell().textContent = cell;
    }
    const button = document.createElement("button");
    const out = data.left_out[moment.first] && data.left_out[moment.last];
    button.textContent = out ? "restore" : "leave out";
    button.addEventListener("click", (event) => {
      event.stopPropagation();
      change(moment.first, moment.last, moment.reason, out);
    });
    line.insertCell().append(button);
    line.addEventListener("click", () => { range = [moment.first, moment.last]; go(moment.first); });
    return line;
  }));
}

function go(wanted) {
  row = Math.min(Math.max(wanted, 0), data.time.length - 1);
  byId("row").value = row;
  for (const camera of data.cameras) byId(camera).src = `recordings/${chosen}/frames/${row}/${camera}`;
  const model = data.predicted ? `, model ${data.predicted[row].toFixed(3)}` : "";
  const speed = data.speed[row] === null ? "" : `, ${data.speed[row].toFixed(1)} mph`;
  const out = data.left_out[row] ? ", left out" : data.by_model[row] ? ", steered by the model: left out" : "";
  byId("values").textContent = `row ${row} of ${data.time.length}, ${data.time[row].toFixed(1)} s: steering ${data.steering[row].toFixed(3)}${model}${speed}${out}`;
  byId("range").textContent = range ? `range: rows ${range[0]} to ${range[1]}` : "";
  draw();
}

function draw() {
  if (!data) return;
  const last = data.time.length - 1;
  const from = data.time.findIndex((time) => time >= data.time[row] - NEAR_SECONDS);
  const beyond = data.time.findIndex((time, index) => index > row && time > data.time[row] + NEAR_SECONDS);
  drawChart(byId("whole"), data, 0, last, row, range);
  drawChart(byId("near"), data, Math.max(from, 0), beyond < 0 ? last : beyond, row, range);
  drawMap(byId("map"), data, row);
}

function play() {
  if (playing) return stop();
  byId("play").firstChild.textContent = "pause ";
  const step = () => {
    if (row >= data.time.length - 1) return stop();
    const pause = Math.min(data.time[row + 1] - data.time[row], 1);
    go(row + 1);
    playing = setTimeout(step, 1000 * pause);
  };
  playing = setTimeout(step, 0);
}

function stop() {
  clearTimeout(playing);
  playing = null;
  byId("play").firstChild.textContent = "play ";
}

function mark(which) {
  const other = range ?? [row, row];
  range = which === "begin" ? [row, Math.max(row, other[1])] : [Math.min(row, other[0]), row];
  go(row);
}

async function change(first, last, reason, restore) {
  const body = JSON.stringify({ first, last, reason, restore });
  const answer = await fetch(`recordings/${chosen}/left_out`, { method: "POST", headers: { "Content-Type": "application/json" }, body });
  const result = await answer.json();
  byId("problem").textContent = answer.ok ? "" : result.error;
  if (!answer.ok) return;
  data.left_out = result.left_out;
  showMoments();
  go(row);
  refresh();
}

function nextMoment(step) {
  if (!moments.length) return;
  const at = moments.findIndex((moment) => range && moment.first === range[0] && moment.last === range[1]);
  const moment = moments[(at + step + moments.length) % moments.length] ?? moments[0];
  range = [moment.first, moment.last];
  go(moment.first);
}

const ACTIONS = {
  " ": play,
  "[": () => mark("begin"),
  "]": () => mark("end"),
  x: () => range && change(range[0], range[1], "by hand", false),
  u: () => change(range?.[0] ?? row, range?.[1] ?? row, "", true),
  n: () => nextMoment(1),
  p: () => nextMoment(-1),
  ArrowLeft: (event) => go(row - (event.shiftKey ? 10 : 1)),
  ArrowRight: (event) => go(row + (event.shiftKey ? 10 : 1)),
};
addEventListener("keydown", (event) => {
  const action = ACTIONS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  const pressesButton = event.key === " " && event.target.tagName === "BUTTON";
  if (!action || !data || event.ctrlKey || event.metaKey || event.altKey || pressesButton) return;
  event.preventDefault();
  action(event);
});
byId("row").addEventListener("input", () => go(Number(byId("row").value)));
byId("whole").addEventListener("click", (event) => {
  const time = (event.offsetX / byId("whole").clientWidth) * data.time.at(-1);
  go(data.time.findIndex((each) => each >= time));
});
byId("play").addEventListener("click", play);
byId("begin").addEventListener("click", ACTIONS["["]);
byId("end").addEventListener("click", ACTIONS["]"]);
byId("leave").addEventListener("click", ACTIONS.x);
byId("restore").addEventListener("click", ACTIONS.u);
addEventListener("resize", draw);
refresh();

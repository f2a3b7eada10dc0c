"use strict";
// Shows the stream of /events; sends what the user changes: target speed, model, recording.

const MINUTE = 60; // seconds in the chart
const TOP = 34; // mph at the chart's upper edge
const STATES = {
  waiting: "waiting for the simulator", driving: "the model drives", corrected: "you drive", manual: "manual driving",
};
const WHO = {
  waiting: "Hold the wheel, or ← →, to steer instead of the model.",
  driving: "Hold the wheel, or ← →, to steer instead of the model.",
  corrected: "You steer. Let go, and the model drives on.",
  manual: "The simulator's own keys steer; it sends no images meanwhile.",
};

const byId = (id) => document.getElementById(id);
const setSpeed = byId("set-speed");
let samples = [];
let stream;
let state = "waiting";
let sliding = false; // whether the user is moving the slider; events do not move it meanwhile
let recording = "";
let shownAt = 0; // time of the chart's right edge

function connect() {
  stream?.close();
  samples = [];
  stream = new EventSource(byId("saliency").checked ? "events?saliency=1" : "events");
  stream.onmessage = (event) => show(JSON.parse(event.data));
  stream.onerror = () => showState("waiting", "no connection to drive.py");
}

function show(now) {
  showState(now.state, STATES[now.state]);
  byId("who").textContent = WHO[now.state];
  if (now.frame) byId("frame").src = "data:image/jpeg;base64," + now.frame;
  byId("rate").textContent = `${now.frames_per_second.toFixed(1)} frames/s, ${now.milliseconds.toFixed(1)} ms per answer`;
  showValues(now);
  showSession(now);
  showSummary(now);
  samples = samples.concat(now.samples).filter((sample) => sample.time > now.time - MINUTE);
  draw(now.time);
}

function showState(name, text) {
  state = name;
  byId("state").className = name;
  byId("state").textContent = text;
}

function showValues(now) {
  current = now.steering;
  byId("steering").textContent = `${now.steering.toFixed(3)} (${now.steering_degrees.toFixed(1)}°)`;
  byId("rim").style.transform = `rotate(${now.steering * FULL_TURN}deg)`;
  byId("wheel").setAttribute("aria-valuenow", now.steering.toFixed(2));
  byId("throttle").value = now.throttle;
  byId("throttle-value").textContent = now.throttle.toFixed(2);
  byId("speed").textContent = now.speed.toFixed(1);
  if (!sliding) setSpeed.value = now.set_speed;
  byId("set-speed-value").textContent = Number(setSpeed.value).toFixed(1);
}

function showSession(now) {
  if (byId("model").value !== now.model) showModels(now.model);
  byId("network").textContent = `network ${now.network}`;
  byId("saliency").disabled = !now.has_saliency;
  byId("saliency").title = now.has_saliency ? "" : "Only a .pt model shows what it looks at, an ONNX file does not.";
  recording = now.recording;
  byId("record").setAttribute("aria-pressed", String(recording !== ""));
  byId("record").firstChild.textContent = recording ? "stop recording " : "record ";
  const failed = now.recording_failed ? `, stopped: ${now.recording_failed}` : "";
  byId("recorded").textContent = recording ? `${now.recorded_frames} frames in ${recording}${failed}` : "not recording";
  const plural = now.corrections === 1 ? "" : "s";
  byId("corrected").textContent = now.corrections ? `${now.corrections} correction${plural} in ${now.corrections_folder}` : "";
}

function showSummary(now) {
  const drive = now.summary;
  const ended = now.state === "waiting" && drive.seconds > 0;
  byId("summary").hidden = !ended;
  if (!ended) return;
  const minutes = `${Math.floor(drive.seconds / 60)}:${String(Math.floor(drive.seconds % 60)).padStart(2, "0")} min`;
  const person = drive.takeovers
    ? `You took the wheel ${drive.takeovers} time${drive.takeovers === 1 ? "" : "s"}, for ${drive.person_seconds.toFixed(0)} s.`
    : "The model drove alone.";
  byId("summary").innerHTML = "<h2>The last drive</h2><p></p><p></p>";
  const [first, second] = byId("summary").querySelectorAll("p");
  first.textContent = `${minutes}, ${drive.metres} m, ${drive.mph} mph on average, ${drive.top_speed} mph at most. ${person}`;
  second.textContent = now.corrections ? "To learn from your corrections, see what drive.py prints when it ends." : "";
}

async function showModels(chosen) {
  const { models } = await (await fetch("models")).json();
  byId("model").replaceChildren(...models.map((name) => new Option(name, name, false, name === chosen)));
}

function draw(now) {
  shownAt = now;
  const canvas = byId("chart");
  const scale = devicePixelRatio;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, width, height);
  const resolved = (name) => { canvas.style.color = `var(${name})`; return getComputedStyle(canvas).color; };
  const column = (time) => width * (1 - (now - time) / MINUTE);
  const row = (mph) => height * (1 - mph / TOP);
  pen.fillStyle = resolved("--person-band");
  for (const [begin, end] of personSpans(now)) pen.fillRect(column(begin), 0, column(end) - column(begin), height);
  drawGrid(pen, width, row, resolved);
  drawLine(pen, resolved("--set"), samples, column, (sample) => row(sample.set_speed));
  drawLine(pen, resolved("--speed"), samples, column, (sample) => row(sample.speed));
  drawLine(pen, resolved("--steer"), samples, column, (sample) => height * (0.5 + sample.steering / 2));
}

// The times between which a person steered, as pairs.
function personSpans(now) {
  const spans = [];
  samples.forEach((sample, index) => {
    const next = Math.min(samples[index + 1]?.time ?? now, sample.time + 1);
    if (!sample.person) return;
    if (spans.length && spans.at(-1)[1] === sample.time) spans.at(-1)[1] = next;
    else spans.push([sample.time, next]);
  });
  return spans;
}

function drawGrid(pen, width, row, resolved) {
  pen.strokeStyle = resolved("--line");
  pen.fillStyle = resolved("--soft");
  pen.lineWidth = 1;
  pen.font = "13px system-ui, sans-serif";
  for (const mph of [10, 20, 30]) {
    pen.strokeRect(0, row(mph), width, 0);
    pen.fillText(`${mph} mph`, 4, row(mph) - 4);
  }
}

function drawLine(pen, colour, points, column, row) {
  pen.strokeStyle = colour;
  pen.lineWidth = 2;
  pen.beginPath();
  points.forEach((point, index) => pen[index ? "lineTo" : "moveTo"](column(point.time), row(point)));
  pen.stroke();
}

async function change(where, body) {
  const answer = await post(where, body);
  byId("problem").textContent = answer.ok ? "" : (await answer.json()).error;
}

function setTarget(mph) {
  return change("speed", { mph: Math.min(Math.max(mph, 0), Number(setSpeed.max)) });
}

setSpeed.addEventListener("input", () => {
  sliding = true;
  byId("set-speed-value").textContent = Number(setSpeed.value).toFixed(1);
});
setSpeed.addEventListener("change", async () => {
  await setTarget(Number(setSpeed.value));
  sliding = false;
  setSpeed.blur(); // so that the arrow keys steer again
});
byId("model").addEventListener("change", () => {
  change("model", { name: byId("model").value });
  byId("model").blur();
});
byId("record").addEventListener("click", () => change("recording", { on: recording === "" }));
byId("saliency").addEventListener("change", connect);
addEventListener("resize", () => draw(shownAt));
addEventListener("keydown", (event) => {
  if (isTyping(event) || event.repeat) return;
  if (event.code === "KeyR") byId("record").click();
  if (event.code === "KeyS") byId("saliency").click();
  if (event.key === "+") setTarget(Number(setSpeed.value) + 1);
  if (event.key === "-") setTarget(Number(setSpeed.value) - 1);
});
connect();

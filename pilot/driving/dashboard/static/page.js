"use strict";
// Shows the stream of /events; sends a new set speed to /speed.

const MINUTE = 60; // seconds in the chart
const TOP = 34; // mph at the chart's upper edge
const WHEEL_TURN = 4; // angle of the drawn steering wheel relative to that of the front wheels
const STATES = { waiting: "waiting for the simulator", driving: "driving", manual: "manual driving" };

const byId = (id) => document.getElementById(id);
const setSpeed = byId("set-speed");
let samples = [];
let stream;
let held = false; // whether the user is moving the slider; events do not move it meanwhile

function connect() {
  stream?.close();
  samples = [];
  stream = new EventSource(byId("saliency").checked ? "events?saliency=1" : "events");
  stream.onmessage = (event) => show(JSON.parse(event.data));
  stream.onerror = () => showState("waiting", "no connection to drive.py");
}

function show(now) {
  showState(now.state, STATES[now.state]);
  if (now.frame) byId("frame").src = "data:image/jpeg;base64," + now.frame;
  byId("rate").textContent = `${now.frames_per_second.toFixed(1)} frames/s, ${now.milliseconds.toFixed(1)} ms an answer`;
  byId("steering").textContent = `${now.steering.toFixed(3)} (${now.steering_degrees.toFixed(1)}°)`;
  byId("wheel").style.transform = `rotate(${now.steering_degrees * WHEEL_TURN}deg)`;
  byId("throttle").value = now.throttle;
  byId("throttle-value").textContent = now.throttle.toFixed(2);
  byId("speed").textContent = now.speed.toFixed(1);
  if (!held) setSpeed.value = now.set_speed;
  byId("set-speed-value").textContent = Number(setSpeed.value).toFixed(1);
  samples = samples.concat(now.samples).filter((sample) => sample.time > now.time - MINUTE);
  draw(now.time);
}

function showState(name, text) {
  byId("state").className = name;
  byId("state").textContent = text;
}

function draw(now) {
  const canvas = byId("chart");
  const { width, height } = canvas;
  const pen = canvas.getContext("2d");
  const style = getComputedStyle(document.documentElement);
  pen.clearRect(0, 0, width, height);
  const column = (sample) => width * (1 - (now - sample.time) / MINUTE);
  const line = (color, row) => {
    pen.strokeStyle = style.getPropertyValue(color);
    pen.lineWidth = 2;
    pen.beginPath();
    samples.forEach((sample, index) => pen[index ? "lineTo" : "moveTo"](column(sample), row(sample)));
    pen.stroke();
  };
  const speedRow = (mph) => height * (1 - mph / TOP);
  pen.strokeStyle = pen.fillStyle = style.getPropertyValue("--line");
  pen.font = "16px system-ui, sans-serif";
  for (const mph of [10, 20, 30]) {
    pen.strokeRect(0, speedRow(mph), width, 0);
    pen.fillText(`${mph} mph`, 4, speedRow(mph) - 4);
  }
  line("--set", (sample) => speedRow(sample.set_speed));
  line("--speed", (sample) => speedRow(sample.speed));
  line("--steer", (sample) => height * (0.5 + sample.steering / 2));
}

setSpeed.addEventListener("input", () => {
  held = true;
  byId("set-speed-value").textContent = Number(setSpeed.value).toFixed(1);
});
setSpeed.addEventListener("change", async () => {
  const body = JSON.stringify({ mph: Number(setSpeed.value) });
  await fetch("speed", { method: "POST", headers: { "Content-Type": "application/json" }, body });
  held = false;
});
byId("saliency").addEventListener("change", connect);
connect();

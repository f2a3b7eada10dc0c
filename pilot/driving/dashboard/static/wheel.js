"use strict";
// Takes over from the model while a key, the drawn wheel or a gamepad's stick is held: posts the steering to /wheel.

const STEP = 0.1; // change of the steering by a key, per tick; full lock after half a second
const TICK_MS = 50;
const FULL_TURN = 120; // degrees by which the drawn wheel is turned for full lock
const DEAD_ZONE = 0.1; // of the stick, because worn sticks do not return exactly to 0
const LEFT = ["ArrowLeft", "KeyA"], RIGHT = ["ArrowRight", "KeyD"];
const FORWARD = ["ArrowUp", "KeyW"], BACKWARD = ["ArrowDown", "KeyX"], STRAIGHT = ["Space"];
const STEERING_KEYS = [...LEFT, ...RIGHT, ...STRAIGHT], PEDAL_KEYS = [...FORWARD, ...BACKWARD];

const wheel = document.getElementById("wheel");
const keys = new Set();
let grabbed = null; // angle in degrees at which the pointer grabbed the wheel, and the steering then
let steering = 0;
let sending = false;
let holding = false;
let current = 0; // steering of the car, from which a person goes on

const isDown = (names) => names.some((name) => keys.has(name));
const limited = (value) => Math.min(Math.max(value, -1), 1);

function angleOf(event) {
  const box = wheel.getBoundingClientRect();
  return (Math.atan2(event.clientX - box.left - box.width / 2, box.top + box.height / 2 - event.clientY) * 180) / Math.PI;
}

function stick() {
  const pad = [...(navigator.getGamepads?.() ?? [])].find((pad) => pad);
  if (!pad) return null;
  const beyond = Math.max(Math.abs(pad.axes[0] ?? 0) - DEAD_ZONE, 0) / (1 - DEAD_ZONE);
  const pedals = (pad.buttons[7]?.value ?? 0) - (pad.buttons[6]?.value ?? 0);
  return { steering: Math.sign(pad.axes[0] ?? 0) * beyond, pedals };
}

// What the person commands now; null: nothing, the model drives.
function command() {
  const pad = stick();
  const byKeys = isDown(STEERING_KEYS);
  const byPad = pad !== null && (pad.steering !== 0 || pad.pedals !== 0);
  if (!byKeys && grabbed === null && !byPad) return null;
  if (!holding) steering = current;
  if (grabbed !== null) steering = grabbed.steering;
  else if (byKeys) {
    const wanted = isDown(RIGHT) - isDown(LEFT);
    steering += limited((wanted - steering) / STEP) * STEP;
  } else steering = pad.steering;
  const pedals = isDown(FORWARD) - isDown(BACKWARD) + (pad?.pedals ?? 0);
  return { steering: limited(steering), throttle: pedals === 0 ? null : limited(pedals) };
}

// One request at a time, so that none overtakes another.
async function tick() {
  if (sending) return;
  const now = command();
  if (now === null && !holding) return;
  holding = now !== null;
  wheel.classList.toggle("held", holding);
  sending = true;
  try {
    await post("wheel", now ?? { steering: null });
  } catch {
    // the page shows by itself that there is no connection
  } finally {
    sending = false;
  }
}

function post(where, body) {
  return fetch(where, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
}

function isTyping(event) {
  const field = event.target.tagName === "SELECT" || event.target.type === "range"; // which use the keys themselves
  return event.ctrlKey || event.metaKey || event.altKey || field;
}

addEventListener("keydown", (event) => {
  const used = STEERING_KEYS.includes(event.code) || PEDAL_KEYS.includes(event.code);
  const pressesButton = event.code === "Space" && /^(BUTTON|SUMMARY)$/.test(event.target.tagName);
  if (!used || isTyping(event) || pressesButton) return;
  event.preventDefault(); // the arrows would scroll the page
  keys.add(event.code);
  tick();
});
addEventListener("keyup", (event) => { keys.delete(event.code); tick(); });
addEventListener("blur", () => { keys.clear(); grabbed = null; tick(); });
wheel.addEventListener("pointerdown", (event) => {
  wheel.setPointerCapture(event.pointerId);
  grabbed = { angle: angleOf(event), steering: current };
  tick();
});
wheel.addEventListener("pointermove", (event) => {
  if (grabbed === null) return;
  const angle = angleOf(event);
  const turned = ((angle - grabbed.angle + 540) % 360) - 180;
  grabbed = { angle, steering: limited(grabbed.steering + turned / FULL_TURN) };
});
for (const end of ["pointerup", "pointercancel"]) {
  wheel.addEventListener(end, () => { grabbed = null; tick(); });
}
setInterval(tick, TICK_MS);

"use strict";
// Drawing of the charts and of the map.

const TOP_MPH = 34; // at a chart's upper edge

function penOf(canvas) {
  const scale = devicePixelRatio;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * scale)) canvas.width = Math.round(width * scale);
  if (canvas.height !== Math.round(height * scale)) canvas.height = Math.round(height * scale);
  const pen = canvas.getContext("2d");
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, width, height);
  return { pen, width, height };
}

// CSS resolves light-dark() only in a property.
function colour(name) {
  document.body.style.setProperty("accent-color", `var(${name})`);
  return getComputedStyle(document.body).accentColor;
}

function line(pen, points, style, width = 1.5) {
  pen.strokeStyle = style;
  pen.lineWidth = width;
  pen.beginPath();
  let drawing = false;
  for (const [x, y] of points) {
    if (x === null || y === null) { drawing = false; continue; }
    pen[drawing ? "lineTo" : "moveTo"](x, y);
    drawing = true;
  }
  pen.stroke();
}

// Ranges of consecutive rows for which a condition holds, as pairs of first and last row.
function spans(from, to, holds) {
  const found = [];
  for (let row = from; row <= to; row++) {
    if (!holds(row)) continue;
    if (found.length && found.at(-1)[1] === row - 1) found.at(-1)[1] = row;
    else found.push([row, row]);
  }
  return found;
}

// Steering and speed of the rows from..to; `current` and `range` are marked.
function drawChart(canvas, data, from, to, current, range) {
  const { pen, width, height } = penOf(canvas);
  const begin = data.time[from], seconds = Math.max(data.time[to] - begin, 1e-6);
  const x = (row) => ((data.time[row] - begin) / seconds) * width;
  const y = (steering) => (steering === null ? null : height * (0.5 + steering / 2.1));
  const fill = (style, holds) => {
    pen.fillStyle = style;
    for (const [first, last] of spans(from, to, holds)) pen.fillRect(x(first), 0, Math.max(x(Math.min(last + 1, to)) - x(first), 1), height);
  };
  fill(colour("--out"), (row) => data.left_out[row] || data.by_model[row]);
  if (range) {
    pen.globalAlpha = 0.25;
    fill(colour("--speed"), (row) => row >= range[0] && row <= range[1]);
    pen.globalAlpha = 1;
  }
  pen.fillStyle = colour("--suspicious");
  for (const [first, last] of spans(from, to, (row) => data.score[row] >= 1)) {
    pen.fillRect(x(first), height - 4, Math.max(x(last) - x(first), 2), 4);
  }
  line(pen, [[0, height / 2], [width, height / 2]], colour("--line"), 1);
  const rows = Array.from({ length: to - from + 1 }, (_, index) => from + index);
  line(pen, rows.map((row) => [x(row), data.speed[row] === null ? null : height * (1 - data.speed[row] / TOP_MPH)]), colour("--speed"));
  line(pen, rows.map((row) => [x(row), y(data.steering[row])]), colour("--label"));
  line(pen, rows.map((row) => [x(row), y(data.label[row])]), colour("--mean"), 2.5);
  if (data.predicted) line(pen, rows.map((row) => [x(row), y(data.predicted[row])]), colour("--model"));
  line(pen, [[x(current), 0], [x(current), height]], colour("--text"), 1.5);
}

// The track, the driven path and the car.
function drawMap(canvas, data, current) {
  const { pen, width, height } = penOf(canvas);
  const known = (axes) => axes[0].map((x, index) => [x, axes[1][index]]).filter(([x]) => x !== null);
  const all = [...known(data.track), ...known(data.path)];
  if (!all.length) return;
  const xs = all.map(([x]) => x), ys = all.map(([, y]) => y);
  const [left, right, bottom, top] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  const scale = 0.92 * Math.min(width / Math.max(right - left, 1), height / Math.max(top - bottom, 1));
  const place = (x, y) => (x === null ? [null, null] : [width / 2 + (x - (left + right) / 2) * scale, height / 2 - (y - (bottom + top) / 2) * scale]);
  line(pen, data.track[0].map((x, index) => place(x, data.track[1][index])), colour("--out"), 6);
  line(pen, data.path[0].map((x, index) => place(x, data.path[1][index])), colour("--speed"), 2);
  pen.fillStyle = colour("--suspicious");
  data.score.forEach((score, row) => {
    const [x, y] = place(data.path[0][row], data.path[1][row]);
    if (score >= 1 && x !== null) pen.fillRect(x - 2, y - 2, 4, 4);
  });
  const [x, y] = place(data.path[0][current], data.path[1][current]);
  if (x === null) return;
  pen.fillStyle = colour("--model");
  pen.beginPath();
  pen.arc(x, y, 6, 0, 7);
  pen.fill();
}

function drawHistogram(canvas, counts) {
  const { pen, width, height } = penOf(canvas);
  const most = Math.max(...counts.map(Math.sqrt), 1); // square roots, so that rare values are seen beside zeros
  pen.fillStyle = colour("--label");
  counts.forEach((count, bin) => {
    const bar = (height * Math.sqrt(count)) / most;
    pen.fillRect((bin * width) / counts.length, height - bar, width / counts.length - 0.5, bar);
  });
}

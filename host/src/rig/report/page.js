"use strict";
// The report's own script: draws the record of the run. Drag or wheel zooms all engines, a double click shows all again.
const run = JSON.parse(document.getElementById("run").textContent);
const main = document.querySelector("main");
const all = [run.from, Math.max(run.to, run.from + 1)];
let shown = all.slice(); // s
let drag = null; // s, both ends, while the button is down
let cursor = null; // s
const LANES = 6, LANE = 14; // lines of text for what happened
const LEFT = 70, RIGHT = 60, TOP = 2 + LANE * LANES, STRIP = 56, FOOT = 24;

function add(parent, name, text, className) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (className) made.className = className;
  parent.append(made);
  return made;
}

function verdict(parent, what) {
  add(parent, "p", what.text, what.failed ? "failed" : "pass");
  for (const problem of what.problems) add(parent, "p", problem, "failed");
}

add(main, "h1", run.title);
const overall = add(main, "div");
overall.id = "verdict";
verdict(overall, run.verdict);
add(main, "p", run.about, "thin");
if (run.bands) add(main, "p", run.bands, "thin");
add(main, "p", "Drag: zoom. Wheel: zoom at the cursor. Double click: all. An event: zoom to it.", "thin");
const legend = add(main, "p");
legend.id = "legend";
for (const [name, line, words] of [
  ["rpm", "solid", "rpm"],
  ["egt", "solid", "EGT"],
  ["commanded", "solid", "demand of the source"],
  ["sent", "solid", "demand on the wire"],
  ["ink", "dashed", "no new value"],
  ["egt", "dotted", "EGT limit of the node"],
]) {
  const key = add(legend, "span");
  add(key, "i").style.borderTop = "3px " + line + " var(--" + name + ")";
  key.append(words);
}
for (const [name, words] of [["gap", "nothing received"], ["mark", "an event"]]) {
  const key = add(legend, "span");
  add(key, "i").style.borderTop = "9px solid var(--" + name + ")";
  key.append(words);
}
const range = add(main, "p");
range.id = "range";

const panels = run.engines.map((engine) => {
  const section = add(main, "section");
  add(section, "h2", engine.caption);
  const paragraph = add(section, "div", undefined, "verdict");
  verdict(paragraph, engine.verdict);
  const canvas = add(section, "canvas");
  const note = add(section, "p", "", "thin");
  const readout = add(section, "p", "", "readout");
  const details = add(section, "details");
  add(details, "summary", "what was counted");
  const table = add(details, "table");
  for (const [head, cell] of engine.counted) {
    const row = add(table, "tr");
    add(row, "td", head);
    add(row, "td", cell);
  }
  const marks = run.happened.filter((mark) => mark[1] === null || mark[1] === engine.name);
  const panel = { engine, canvas, readout, note, marks };
  listen(panel);
  return panel;
});

add(main, "h2", "Events");
if (run.dropped) add(main, "p", run.dropped + " later events are not stored.", "thin");
const events = add(main, "table");
events.id = "events";
for (const [t, engine, text] of run.events) {
  const row = add(events, "tr");
  add(row, "td", t.toFixed(1) + " s");
  add(row, "td", engine === null ? "" : engine);
  add(row, "td", text);
  row.addEventListener("click", () => {
    show(t - 10, t + 10);
    main.scrollIntoView();
  });
}

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
}

// A step of 1, 2 or 5 times a power of ten that divides this into about this number of parts.
function step(length, count) {
  const rough = length / count, power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find((times) => times * power >= rough);
}

function show(from, to) {
  const length = Math.min(Math.max(to - from, 1), all[1] - all[0]);
  const begin = Math.min(Math.max(from, all[0]), all[1] - length);
  shown = [begin, begin + length];
  draw();
}

function width(panel) {
  return panel.canvas.clientWidth - LEFT - RIGHT;
}

function x(panel, t) {
  return LEFT + ((t - shown[0]) / (shown[1] - shown[0])) * width(panel);
}

// Where the names of what happened are, as in the plot: no name covers another one or is crossed by the line below a name.
function placed(context, panel, right) {
  const seen = panel.marks.filter(([t]) => t >= shown[0] && t <= shown[1]);
  const marks = seen.map(([t, , words]) => {
    const at = x(panel, t), long = context.measureText(words).width + 8;
    return { at, words, long, forced: at + long > right, lane: null, ends: false };
  });
  const span = ({ at, long, ends }) => (ends ? [at - long, at] : [at, at + long]);
  const inside = (at, [from, to]) => at > from && at < to;
  const goes = (one, other) => {
    if (other.lane === null) return true;
    const a = span(one), b = span(other);
    const covers = one.lane === other.lane && a[0] < b[1] && b[0] < a[1];
    return !covers && !(one.lane <= other.lane && inside(one.at, b)) && !(other.lane <= one.lane && inside(other.at, a));
  };
  // Those that would run out of the picture end at their line. They come first, from the last one on.
  for (const mark of [...marks.filter((mark) => mark.forced).reverse(), ...marks.filter((mark) => !mark.forced)]) {
    const sides = mark.forced ? [true] : [false, true];
    const places = sides.flatMap((ends) => Array.from({ length: LANES }, (_, lane) => ({ ...mark, ends, lane })));
    const place = places.find((place) => span(place)[0] >= LEFT && marks.every((other) => other === mark || goes(place, other)));
    if (place) Object.assign(mark, place);
  }
  return marks;
}

function time(panel, event) {
  const at = event.clientX - panel.canvas.getBoundingClientRect().left - LEFT;
  const t = shown[0] + (at / width(panel)) * (shown[1] - shown[0]);
  return Math.min(Math.max(t, shown[0]), shown[1]);
}

function listen(panel) {
  const canvas = panel.canvas;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    drag = [time(panel, event), time(panel, event)];
  });
  canvas.addEventListener("pointermove", (event) => {
    cursor = time(panel, event);
    if (drag) drag[1] = cursor;
    draw();
  });
  canvas.addEventListener("pointerup", () => {
    const [from, to] = drag ? drag.slice().sort((a, b) => a - b) : [0, 0];
    drag = null;
    if (to - from > (shown[1] - shown[0]) / 200) show(from, to);
    else draw();
  });
  canvas.addEventListener("pointerleave", () => {
    cursor = null;
    draw();
  });
  canvas.addEventListener("dblclick", () => show(...all));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const t = time(panel, event), times = event.deltaY < 0 ? 0.8 : 1.25;
    show(t - (t - shown[0]) * times, t + (shown[1] - t) * times);
  }, { passive: false });
}

// The last point that has begun at this time.
function index(times, t) {
  let low = 0, high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle + 1;
    else high = middle;
  }
  return Math.max(low - 1, 0);
}

// What a text is not placed on: of each curve its lowest and highest place in each column of pixels, other lines, and texts.
function obstacles(canvas) {
  return { curves: [], wide: Math.ceil(canvas.clientWidth) + 1, lines: [], texts: [] };
}

// A straight part of a curve.
function cover(curve, x1, y1, x2, y2) {
  if (x2 < x1) [x1, y1, x2, y2] = [x2, y2, x1, y1];
  const slope = x2 > x1 ? (y2 - y1) / (x2 - x1) : 0, last = Math.min(Math.floor(x2), curve.low.length - 1);
  for (let column = Math.max(Math.floor(x1), 0); column <= last; column++) {
    const a = x2 > x1 ? y1 + slope * (Math.max(column, x1) - x1) : y1, b = x2 > x1 ? y1 + slope * (Math.min(column + 1, x2) - x1) : y2;
    curve.low[column] = Math.min(curve.low[column], a, b);
    curve.high[column] = Math.max(curve.high[column], a, b);
  }
}

// Whether nothing is in this rectangle.
function is_free(around, [left, top, right, bottom]) {
  const meets = (a, b, c, d) => a < right && c > left && b < bottom && d > top;
  if (around.texts.some((text) => meets(text[0] - 4, text[1], text[2] + 4, text[3]))) return false;
  if (around.lines.some((line) => meets(line[0] - 1, line[1] - 1, line[2] + 1, line[3] + 1))) return false;
  for (const curve of around.curves)
    for (let column = Math.max(Math.floor(left), 0); column < Math.min(right, around.wide); column++)
      if (curve.low[column] < bottom + 1 && curve.high[column] > top - 1) return false;
  return true;
}

// A text at the first free one of these places, each its left end and its line of writing, and the point to which a leader goes
// from it, if it has one. Whether there is one.
function place(context, around, words, places, name) {
  const long = context.measureText(words).width;
  for (const [at, y, end] of places) {
    const box = [at, y - 10, at + long, y + 3];
    if (!is_free(around, box)) continue;
    if (end !== undefined) {
      const from = end < at ? at - 3 : at + long + 3, middle = y - 4;
      const [a, b] = [Math.min(from, end), Math.max(from, end)];
      if (around.texts.some((text) => text[0] < b && text[2] > a && text[1] < middle && text[3] > middle)) continue;
      context.strokeStyle = colour(name);
      context.lineWidth = 1;
      context.beginPath();
      context.moveTo(from, middle);
      context.lineTo(end, middle);
      context.stroke();
      context.fillStyle = colour(name);
      context.fillRect(end - 2, middle - 2, 4, 4);
      around.lines.push([a, middle, b, middle]);
    }
    text(context, words, at, y, "left", name);
    around.texts.push(box);
    return true;
  }
  return false;
}

// Numbers from the first to the last; the first one in any case.
function steps(first, last, each) {
  const count = Math.max(Math.floor((last - first) / each), 0);
  return Array.from({ length: count + 1 }, (_, i) => first + i * each);
}

// Places for a text, from the bottom up, in each line from the left to the right.
function within(first, last, top, bottom) {
  return steps(bottom - 6, top + 13, -8).flatMap((y) => steps(first, last, 8).map((at) => [at, y]));
}

// A value: its least, and what its most is above that. Broken where there is none, dashed where it is old.
function curve(panel, context, around, [least, above], old, y, name, thick) {
  const times = panel.engine.t, first = index(times, shown[0]), last = Math.min(index(times, shown[1]) + 1, times.length - 1);
  context.strokeStyle = colour(name);
  context.fillStyle = colour(name);
  context.lineWidth = thick;
  let begun = false, dashed = false, before = null;
  const covered = { low: new Float64Array(around.wide).fill(Infinity), high: new Float64Array(around.wide).fill(-Infinity) };
  around.curves.push(covered);
  for (let i = first; i <= last; i++) {
    const now = least[i] !== null, is_old = old && (panel.engine.flags[i] & old) !== 0;
    if (begun && (!now || is_old !== dashed)) {
      if (now && dashed) context.lineTo(x(panel, times[i]), y(least[i] + above[i]));
      context.stroke();
      begun = false;
    }
    if (!now) {
      before = null;
      continue;
    }
    const at = x(panel, times[i]), most = y(least[i] + above[i]);
    if (!begun) {
      dashed = is_old;
      context.setLineDash(dashed ? [5, 4] : []);
      context.beginPath();
      // From the last new value on it is old.
      if (dashed && i > first && least[i - 1] !== null) context.moveTo(x(panel, times[i - 1]), y(least[i - 1] + above[i - 1]));
      else context.moveTo(at, most);
      context.lineTo(at, most);
      begun = true;
    } else {
      context.lineTo(at, most);
    }
    if (before !== null) cover(covered, before[0], before[1], at, most);
    cover(covered, at, most, at, y(least[i]));
    before = [at, most];
    if (above[i] > 0) {
      const next = x(panel, times[Math.min(i + 1, times.length - 1)]);
      context.globalAlpha = 0.5;
      context.fillRect(at, most, Math.max(next - at, 1), y(least[i]) - most);
      context.globalAlpha = 1;
    }
  }
  if (begun) context.stroke();
  context.setLineDash([]);
}

// Times from which to which this holds, of those that are shown.
function spans(engine, holds) {
  const found = [];
  let begun = null;
  engine.t.forEach((t, i) => {
    if (holds(i)) begun ??= t;
    else if (begun !== null) {
      found.push([begun, t]);
      begun = null;
    }
  });
  if (begun !== null) found.push([begun, engine.t[engine.t.length - 1]]);
  return found.filter(([from, to]) => to >= shown[0] && from <= shown[1]);
}

function text(context, words, at, y, align, name) {
  context.fillStyle = colour(name);
  context.textAlign = align;
  context.fillText(words, at, y);
}

function panel_draw(panel) {
  const { canvas, engine } = panel, ratio = window.devicePixelRatio || 1;
  canvas.width = canvas.clientWidth * ratio;
  canvas.height = canvas.clientHeight * ratio;
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  context.font = "13px sans-serif";
  const around = obstacles(canvas);
  const right = canvas.clientWidth - RIGHT, bottom = canvas.clientHeight - FOOT;
  const strip = engine.by_rpm ? 0 : STRIP, middle = bottom - (strip ? strip + 14 : 0);
  const most_rpm = engine.most_rpm, most_egt = engine.most_egt;
  const rpm = (value) => middle - (value / most_rpm) * (middle - TOP);
  const egt = (value) => middle - (value / most_egt) * (middle - TOP);
  const percent = (value) => bottom - (value / 100) * strip;

  context.save();
  context.beginPath();
  context.rect(LEFT, 0, right - LEFT, canvas.clientHeight);
  context.clip();
  // Where nothing is received.
  const gaps = spans(engine, (i) => (engine.flags[i] & 8) === 0);
  context.fillStyle = colour("gap");
  for (const [from, to] of gaps) context.fillRect(x(panel, from), TOP, x(panel, to) - x(panel, from) + 0.5, middle - TOP);
  context.restore();

  context.strokeStyle = colour("grid");
  context.lineWidth = 1;
  const line = (x1, y1, x2, y2) => {
    context.beginPath();
    context.moveTo(x1, y1);
    context.lineTo(x2, y2);
    context.stroke();
  };
  for (let value = 0, each = step(most_rpm, 4); value <= most_rpm; value += each) {
    line(LEFT, rpm(value), right, rpm(value));
    text(context, value.toLocaleString("en").replaceAll(",", " "), LEFT - 6, rpm(value) + 4, "right", "rpm");
  }
  for (let value = 0, each = step(most_egt, 4); value <= most_egt; value += each) {
    text(context, value + " °C", right + 4, egt(value) + 4, "left", "egt");
  }
  if (strip) {
    for (const value of [0, 50, 100]) {
      line(LEFT, percent(value), right, percent(value));
      text(context, value + " %", LEFT - 6, percent(value) + 4, "right", "sent");
    }
  }
  const each = step(shown[1] - shown[0], 10);
  for (let t = Math.ceil(shown[0] / each) * each; t <= shown[1]; t += each) {
    line(x(panel, t), bottom, x(panel, t), bottom + 5);
    text(context, (each < 1 ? t.toFixed(1) : Math.round(t)) + " s", x(panel, t), bottom + 18, "center", "ink");
  }

  context.save();
  context.beginPath();
  context.rect(LEFT, 0, right - LEFT, canvas.clientHeight);
  context.clip();
  if (engine.egt_limit !== null) {
    context.strokeStyle = colour("egt");
    context.setLineDash([2, 6]);
    line(LEFT, egt(engine.egt_limit), right, egt(engine.egt_limit));
    context.setLineDash([]);
    around.lines.push([LEFT, egt(engine.egt_limit), right, egt(engine.egt_limit)]);
  }
  curve(panel, context, around, engine.commanded_rpm, 0, rpm, "commanded", 3);
  curve(panel, context, around, engine.sent_rpm, 0, rpm, "sent", 1.5);
  curve(panel, context, around, engine.rpm, 1, rpm, "rpm", 1.8);
  curve(panel, context, around, engine.egt, 2, egt, "egt", 1.8);
  if (strip) {
    curve(panel, context, around, engine.commanded, 0, percent, "commanded", 3);
    curve(panel, context, around, engine.sent, 0, percent, "sent", 1.5);
  }
  // An AMT ECU with a fault sends sets that carry no rpm.
  const dark = spans(engine, (i) => (engine.flags[i] & 24) === 24 && engine.rpm[0][i] === null);
  for (const [from, to] of dark) {
    context.strokeStyle = colour("rpm");
    context.lineWidth = 3;
    line(x(panel, from), middle - 20, x(panel, to), middle - 20);
    around.lines.push([x(panel, from), middle - 21, x(panel, to), middle - 19]);
  }
  panel.unnamed = 0;
  panel.placed = placed(context, panel, right);
  for (const { at, words, lane, ends } of panel.placed) {
    // Up to its name.
    const top = lane === null ? TOP - 4 : 2 + LANE * lane;
    context.strokeStyle = colour("mark");
    context.lineWidth = 1;
    line(at, top, at, bottom);
    around.lines.push([at, top, at, bottom]);
    if (lane === null) panel.unnamed += 1;
    else text(context, words, ends ? at - 2 : at + 2, 12 + LANE * lane, ends ? "right" : "left", "mark");
  }
  // The names come last, where no line is, as in the plot.
  panel.named = [];
  // Each list of places is made only if the one before has none.
  const put = (words, name, ...lists) => {
    if (lists.some((places) => place(context, around, words, places(), name))) panel.named.push(words);
    else panel.unnamed += 1;
  };
  if (engine.egt_limit !== null) {
    const words = "EGT limit " + engine.egt_limit + " °C", long = context.measureText(words).width, y = egt(engine.egt_limit);
    const places = steps(right - 4 - long, LEFT, -8).flatMap((at) => [[at, y + 14], [at, y - 5]]);
    place(context, around, words, places, "egt");
  }
  const ends = ([from, to]) => [Math.max(x(panel, from), LEFT), Math.min(x(panel, to), right)];
  // What is too short to be seen is not named.
  const seen = (spans) => spans.map(ends).filter(([from, to]) => to - from > 4);
  const names = (spans, words, floor, name) => {
    const long = context.measureText(words).width, inside = (at) => at > LEFT && at + long < right;
    for (const [from, to] of seen(spans)) {
      const first = Math.min(from + 3, right - long), deep = Math.min(4, (to - from) / 2);
      const touching = [to + 3, from - 3 - long].filter(inside);
      const apart = (far) => [[to + far, to - deep], [from - far - long, from + deep]].filter(([at]) => inside(at));
      const led = ([at, end]) => within(at, at, TOP, floor).map(([, y]) => [at, y, end]);
      put(
        words, name,
        () => within(first, to - long, TOP, floor),
        () => touching.flatMap((at) => within(at, at, TOP, floor)),
        () => steps(12, 240, 8).flatMap(apart).flatMap(led),
      );
    }
  };
  names(gaps, "nothing received", middle, "ink");
  names(dark, "fault sets: no rpm", middle - 20, "rpm");
  panel.note.textContent =
    panel.unnamed === 0 ? "" : panel.unnamed + " more marked without a name: zoom in for room, or see the events";
  if (drag) {
    context.fillStyle = colour("mark");
    context.globalAlpha = 0.2;
    context.fillRect(x(panel, drag[0]), TOP, x(panel, drag[1]) - x(panel, drag[0]), bottom - TOP);
    context.globalAlpha = 1;
  }
  if (cursor !== null) {
    context.strokeStyle = colour("ink");
    context.lineWidth = 1;
    line(x(panel, cursor), TOP, x(panel, cursor), bottom);
  }
  context.restore();
  panel.readout.textContent = cursor === null ? "" : values(engine, cursor);
}

// What was at this time, in words.
function values(engine, t) {
  const i = index(engine.t, t);
  const value = ([least, above], unit, digits) => {
    if (least[i] === null) return null;
    const low = least[i].toFixed(digits), high = (least[i] + above[i]).toFixed(digits);
    return (low === high ? low : low + " to " + high) + " " + unit;
  };
  const old = (bit) => ((engine.flags[i] & bit) !== 0 ? " (no new value)" : "");
  const parts = [engine.t[i].toFixed(1) + " s", last(engine.stages, i)];
  const put = (name, text, behind) => parts.push(name + " " + (text === null ? "unknown" : text + behind));
  put("rpm:", value(engine.rpm, "rpm", 0), old(1));
  put("EGT:", value(engine.egt, "°C", 1), old(2));
  const commanded = value(engine.commanded, "%", 1) ?? value(engine.commanded_rpm, "rpm", 0);
  const sent = value(engine.sent, "%", 1) ?? value(engine.sent_rpm, "rpm", 0);
  parts.push("commanded: " + (commanded ?? ((engine.flags[i] & 4) !== 0 ? "nothing, the source is silent" : "standby")));
  parts.push("sent: " + (sent ?? last(engine.wire, i)));
  if ((engine.flags[i] & 8) === 0) parts.push("nothing is received");
  if ((engine.flags[i] & 16) !== 0) parts.push("the ECU reports a fault");
  return parts.join(", ");
}

// What holds at this point, of a list of changes.
function last(changes, i) {
  let found = "";
  for (const [from, name] of changes) {
    if (from > i) break;
    found = name;
  }
  return found;
}

function draw() {
  range.textContent = "Shown: " + shown[0].toFixed(1) + " s to " + shown[1].toFixed(1) + " s";
  panels.forEach(panel_draw);
}

window.addEventListener("resize", draw);
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
draw();

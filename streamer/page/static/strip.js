// The strip of what the robot was told to do in the last minute, with the stops.

import { fitted } from "./curves.js";

const SHOWN_S = 60;
const TOP = 2, HIGH = 22;
const ROWS = [36, 51, 66]; // of names below the blocks: a name may be longer than its block
const LONGEST_PX = 170, GAP_PX = 10;
const REFUSED_PX = 18;
const LETTERS = { STOP: "S", ESTOP: "E", KILL: "K" };
const KEPT = 60;

export class Strip {
  constructor(canvas) {
    this.canvas = canvas;
    this.begin();
  }

  // A connection is made: what has happened is told anew.
  begin() {
    this.marks = []; // stops: {at_s, letter}
  }

  // A message of the loop at a time of the run [s].
  happened({ time_s, kind, message }) {
    if (kind !== "request" || !(message in LETTERS)) return;
    this.marks.push({ at_s: time_s, letter: LETTERS[message] });
    if (this.marks.length > KEPT) this.marks.shift();
  }

  // [[entry, begin, end]] in seconds of the run, the oldest first.
  blocks(entries, now_s) {
    const placed = entries.filter((one) => Number.isFinite(one.at_s) && one.at_s <= now_s).sort((a, b) => a.at_s - b.at_s);
    return placed.map((entry) => [entry, entry.at_s, Math.max(Math.min(entry.ended?.[0] ?? now_s, now_s), entry.at_s)]);
  }

  draw(entries, now_s) {
    if (!this.canvas.clientWidth) return;
    const [context, width, height] = fitted(this.canvas);
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name);
    const x = (time) => width * (1 - (now_s - time) / SHOWN_S);
    context.font = "12px system-ui, sans-serif";
    context.textBaseline = "middle";
    const blocks = this.blocks(entries, now_s).filter(([entry, , end]) => end >= now_s - SHOWN_S);
    for (const [entry, begin, end] of blocks) {
      const left = Math.min(Math.max(x(begin), 0), width - REFUSED_PX);
      if (entry.state === "refused") { refused(context, left, colour); continue; }
      context.fillStyle = entry.stick ? colour("--plan") : colour("--accent");
      context.beginPath();
      context.roundRect(left, TOP, Math.max(x(end) - left - 2, 3), HIGH, 5);
      context.fill();
    }
    const named = names(context, blocks.map(([entry, at_s]) => [entry.text, Math.max(x(at_s), 0)]), width);
    context.fillStyle = colour("--edge");
    for (const { begin, row } of named) context.fillRect(begin + 1, TOP + HIGH, 1, ROWS[row] - TOP - HIGH - 7);
    for (const { text, left, wide, row } of named) {
      context.fillStyle = colour("--card");
      context.fillRect(left - 2, ROWS[row] - 7, wide + 4, 14);
      context.fillStyle = colour("--ink");
      context.fillText(text, left, ROWS[row]);
    }
    for (const { at_s, letter } of this.marks) {
      if (at_s < now_s - SHOWN_S || at_s > now_s) continue;
      const at = Math.min(x(at_s), width - 9);
      context.fillStyle = letter === "S" ? "#f2b705" : "#c4201a";
      context.fillRect(at - 1, TOP, 2, HIGH);
      context.fillRect(at - 9, TOP, 18, 18);
      context.fillStyle = letter === "S" ? "#241c00" : "#ffffff";
      context.textAlign = "center";
      context.fillText(letter, at, TOP + 9.5);
    }
    context.textAlign = "center";
    context.fillStyle = colour("--quiet");
    if (!blocks.length && !this.marks.some(({ at_s }) => at_s >= now_s - SHOWN_S)) context.fillText("nothing in the last minute", width / 2, TOP + HIGH / 2);
    for (const ago of [60, 45, 30, 15, 0]) {
      context.textAlign = ago === 60 ? "left" : ago === 0 ? "right" : "center";
      context.fillText(ago ? `−${ago} s` : "now", x(now_s - ago), height - 9);
    }
    context.textAlign = "left";
  }
}

// Not done: hatched, with a cross, so that it is told apart without colours.
function refused(context, left, colour) {
  context.save();
  context.beginPath();
  context.roundRect(left, TOP, REFUSED_PX, HIGH, 4);
  context.strokeStyle = colour("--bad");
  context.lineWidth = 1.5;
  context.stroke();
  context.clip();
  context.lineWidth = 1;
  context.beginPath();
  for (let from = -HIGH; from < REFUSED_PX; from += 5) {
    context.moveTo(left + from, TOP + HIGH);
    context.lineTo(left + from + HIGH, TOP);
  }
  context.stroke();
  context.restore();
  context.fillStyle = colour("--card");
  context.fillRect(left + 3, TOP + 7, REFUSED_PX - 6, HIGH - 14);
  context.fillStyle = colour("--bad");
  context.textAlign = "center";
  context.fillText("×", left + REFUSED_PX / 2, TOP + HIGH / 2);
  context.textAlign = "left";
}

// [{text, begin, left, wide, row}] of the names of blocks [[text, begin]]; the newest first, and none where all rows are taken.
function names(context, blocks, width) {
  const free = ROWS.map(() => width), found = [];
  for (const [text, begin] of blocks.reverse()) {
    const shown = cut(context, text, LONGEST_PX), wide = context.measureText(shown).width;
    const left = Math.max(Math.min(begin, width - wide), 0);
    const row = free.findIndex((end) => left + wide <= end);
    if (row < 0) continue;
    free[row] = left - GAP_PX;
    found.push({ text: shown, begin, left, wide, row });
  }
  return found;
}

// As much of a text as fits, "…" where there is more.
function cut(context, text, width) {
  if (context.measureText(text).width <= width) return text;
  let kept = text;
  while (kept && context.measureText(`${kept}…`).width > width) kept = kept.slice(0, -1);
  return kept ? `${kept.trimEnd()}…` : "";
}

// The strip of what the robot was told to do in the last minute, with the stops.

import { fitted } from "./curves.js";

const SHOWN_S = 60;
const TOP = 4, HIGH = 28;
const REFUSED_PX = 18;
const LETTERS = { STOP: "S", ESTOP: "E", KILL: "K" };
const MOVES = ["READY", "STREAMING", "HOLD"]; // states in which something can be followed
const KEPT = 60;

export class Strip {
  constructor(canvas) {
    this.canvas = canvas;
    this.begin();
  }

  // A connection is made: what has happened is told anew.
  begin() {
    this.marks = []; // stops: {at_s, letter}
    this.rests = []; // when the robot had come to a stand [s]
    this.cuts = []; // when whatever it followed was over [s]
  }

  // A message of the loop at a time of the run [s].
  happened({ time_s, kind, message }) {
    if (kind === "request" && message in LETTERS) {
      this.marks.push({ at_s: time_s, letter: LETTERS[message] });
      this.cuts.push(time_s);
    }
    const [, from, to] = message.match(/^([A-Z]+) -> ([A-Z]+)/) ?? [];
    if (from === "STREAMING" && to === "HOLD") this.rests.push(time_s);
    if (to && !MOVES.includes(to)) this.cuts.push(time_s);
    for (const list of [this.marks, this.rests, this.cuts]) if (list.length > KEPT) list.shift();
  }

  // Nothing is known after this time [s].
  lost(time_s) {
    this.cuts.push(time_s);
  }

  // [[entry, begin, end]] in seconds of the run: a motion ends with its last step, at a stop, or as the next one begins.
  blocks(entries, now_s) {
    const placed = entries.filter((one) => Number.isFinite(one.at_s) && one.at_s <= now_s).sort((a, b) => a.at_s - b.at_s);
    return placed.map((entry, index) => {
      const steps = entry.answer.steps ?? [];
      const measured = steps.some((step) => step.amount !== undefined);
      const after = (times) => Math.min(...times.filter((time) => time > entry.at_s));
      const ends = [now_s, placed[index + 1]?.at_s ?? now_s, entry.end_s ?? now_s, after(this.cuts)];
      if (!measured) ends.push(after(this.rests));
      if (steps.length && steps.every((step) => Number.isFinite(step.end_s))) ends.push(Math.max(...steps.map((step) => step.end_s)));
      return [entry, entry.at_s, Math.max(Math.min(...ends), entry.at_s)];
    });
  }

  draw(entries, now_s) {
    if (!this.canvas.clientWidth) return;
    const [context, width, height] = fitted(this.canvas);
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name);
    const x = (time) => width * (1 - (now_s - time) / SHOWN_S);
    context.font = "12px system-ui, sans-serif";
    context.textBaseline = "middle";
    for (const [entry, begin, end] of this.blocks(entries, now_s)) {
      if (end < now_s - SHOWN_S) continue;
      const left = Math.max(x(begin), 0);
      if (entry.state === "refused") { refused(context, left, colour); continue; }
      const wide = Math.max(x(end) - left - 2, 3);
      context.fillStyle = entry.stick ? colour("--plan") : colour("--accent");
      context.beginPath();
      context.roundRect(left, TOP, wide, HIGH, 6);
      context.fill();
      context.fillStyle = colour("--on-accent");
      context.fillText(cut(context, entry.text, wide - 14), left + 8, TOP + HIGH / 2);
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
    context.fillStyle = colour("--quiet");
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

// As much of a text as fits, "…" where there is more.
function cut(context, text, width) {
  if (width < 12) return "";
  if (context.measureText(text).width <= width) return text;
  let kept = text;
  while (kept && context.measureText(`${kept}…`).width > width) kept = kept.slice(0, -1);
  return kept ? `${kept.trimEnd()}…` : "";
}

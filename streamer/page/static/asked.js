// What was asked: the prompt, its history with what was heard, and the timeline.

import { fitted } from "./curves.js";

const SUGGESTIONS = ["wave with the right hand", "walk forward", "turn 90 degrees to the left", "stand still", "two steps back, then bow", "raise both arms"];
const SHOWN_S = 60;
const KEPT = 40;
const LONGEST = 160; // characters of an answer that is not folded
const MARKS = {
  accepted: ["accepted", "good"], slowed: ["slowed", "good"], partly: ["in part", "warn"], done: ["done", "good"], late: ["not finished", "warn"],
  refused: ["refused", "bad"], expired: ["too late", "bad"], superseded: ["replaced", "wait"], wait: ["sent", "wait"],
};

export class Asked {
  constructor(link) {
    this.link = link;
    this.entries = []; // newest first: {key, text, source, state, answer, at_s}
    this.list = document.getElementById("history");
    this.said = document.getElementById("said");
    this.timeline = document.getElementById("timeline");
    this.prompt = document.getElementById("prompt");
    this.past = [];
    this.place = 0;
    document.getElementById("ask").onsubmit = (event) => { event.preventDefault(); this.ask(this.prompt.value); };
    this.prompt.addEventListener("keydown", (event) => this.recall(event));
    const chips = document.getElementById("suggestions");
    for (const text of SUGGESTIONS) {
      const chip = document.createElement("button");
      chip.type = "button";
      chip.textContent = text;
      chip.onclick = () => this.ask(text);
      chips.append(chip);
    }
  }

  ask(words) {
    const text = words.trim();
    if (!text) return;
    this.prompt.value = "";
    this.past.push(text);
    this.place = this.past.length;
    this.send({ type: "text", text }, text);
  }

  // Send a target, told as `text`; resolves to its answer.
  async send(message, text) {
    const entry = { key: null, text, source: this.link.source, state: "wait", answer: {} };
    this.add(entry);
    const answer = await this.link.send(message);
    Object.assign(entry, { state: answer.state, answer, key: answer.target ?? null, at_s: entry.at_s ?? null });
    this.merge(entry);
    this.show();
    this.said.textContent = `${text}: ${MARKS[outcome(entry)]?.[0] ?? answer.state}${answer.reason ? `, ${answer.reason}` : ""}`;
    return answer;
  }

  // The answer to a target of anyone; a later version of one says how its steps ended.
  heard(message) {
    const key = message.id || `item ${message.item}`;
    let entry = this.entries.find((one) => one.key === key);
    if (!entry && message.source === this.link.source) {
      // Its own answer comes over the same connection and may be later than this.
      entry = this.entries.find((one) => one.key === null && one.state === "wait" && one.text === message.asked);
      if (entry) entry.key = key;
    }
    const velocity = message.heard_as === "velocity" || message.asked.startsWith("velocity") || message.asked.startsWith("[");
    if (!entry && velocity && message.state !== "refused") {
      const last = this.entries[0];
      if (last?.stick && last.source === message.source) { last.answer = message; last.key = key; this.show(); return; }
      entry = this.add({ key, text: "stick", stick: true, source: message.source, state: message.state, answer: message, at_s: message.at_s });
    } else if (!entry) {
      entry = this.add({ key, text: message.asked, source: message.source, state: message.state, answer: message, at_s: message.at_s });
    }
    Object.assign(entry, { state: message.state, answer: message, at_s: message.at_s ?? entry.at_s });
    this.show();
  }

  add(entry) {
    this.entries.unshift(entry);
    this.entries.length = Math.min(this.entries.length, KEPT);
    this.show();
    return entry;
  }

  merge(entry) {
    const other = this.entries.find((one) => one !== entry && one.key !== null && one.key === entry.key);
    if (other) {
      Object.assign(entry, { at_s: other.at_s, answer: other.answer });
      this.entries.splice(this.entries.indexOf(other), 1);
    }
  }

  recall(event) {
    const step = { ArrowUp: -1, ArrowDown: 1 }[event.key];
    if (!step || !this.past.length) return;
    event.preventDefault();
    this.place = Math.min(Math.max(this.place + step, 0), this.past.length);
    this.prompt.value = this.past[this.place] ?? "";
  }

  show() {
    this.list.replaceChildren(...this.entries.slice(0, 12).map((entry) => {
      const item = document.createElement("li");
      const [words, kind] = MARKS[outcome(entry)] ?? [entry.state, "wait"];
      item.append(made("b", entry.text));
      item.append(made("span", words, `mark ${kind}`));
      const told = explained(entry, this.link.source);
      if (told) item.append(this.told(entry, told, kind === "bad" ? "no" : ""));
      return item;
    }));
  }

  // What became of it; a long one is folded behind its first part.
  told(entry, text, kind) {
    const end = text.indexOf("; ");
    if (text.length <= LONGEST || end < 0) return made("p", text, kind);
    const folded = document.createElement("details");
    folded.open = Boolean(entry.unfolded);
    folded.ontoggle = () => { entry.unfolded = folded.open; };
    folded.append(made("summary", text.slice(0, end)), document.createTextNode(text.slice(end + 2)));
    return folded;
  }

  // What the robot follows now, in words; "" where it stands.
  get now() {
    const entry = this.entries.find((one) => one.at_s !== null && one.at_s !== undefined && ["accepted", "slowed", "partly"].includes(one.state));
    return entry ? entry.text : "";
  }

  draw(now_s) {
    const [context, width, height] = fitted(this.timeline);
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name);
    const x = (time) => width * (1 - (now_s - time) / SHOWN_S);
    const placed = this.entries.filter((one) => Number.isFinite(one.at_s) && one.at_s <= now_s).sort((a, b) => a.at_s - b.at_s);
    context.font = "12px system-ui, sans-serif";
    context.textBaseline = "middle";
    placed.forEach((entry, index) => {
      const end = Math.min(placed[index + 1]?.at_s ?? now_s, now_s);
      if (end < now_s - SHOWN_S) return;
      const [left, right] = [Math.max(x(entry.at_s), 0), x(end)];
      const refused = entry.state === "refused";
      context.fillStyle = refused ? colour("--bad") : entry.stick ? colour("--plan") : colour("--accent");
      context.beginPath();
      context.roundRect(left, 4, Math.max(right - left - 2, 3), 28, 6);
      context.fill();
      if (right - left > 30) {
        context.save();
        context.beginPath();
        context.rect(left, 4, right - left - 8, 28);
        context.clip();
        context.fillStyle = colour("--on-accent");
        context.fillText(entry.text, left + 8, 18);
        context.restore();
      }
    });
    context.fillStyle = colour("--quiet");
    for (const ago of [60, 45, 30, 15, 0]) {
      context.textAlign = ago === 60 ? "left" : ago === 0 ? "right" : "center";
      context.fillText(ago ? `−${ago} s` : "now", x(now_s - ago), height - 9);
    }
    context.textAlign = "left";
  }
}

// What became of it: the robot has measured the steps that have an amount.
function outcome({ state, answer }) {
  const measured = (answer.steps ?? []).filter((step) => step.amount !== undefined);
  if (!["accepted", "slowed"].includes(state) || !measured.length || !measured.every((step) => step.end)) return state;
  const ends = measured.map((step) => step.end);
  return ends.every((end) => end === "done") ? "done" : ends.includes("time limit") ? "late" : state;
}

function made(tag, text, kind = "") {
  const element = document.createElement(tag);
  element.textContent = text;
  if (kind) element.className = kind;
  return element;
}

// A kind of motion in words: "walk-back" is "walk back".
function plain(kind) {
  return kind.replaceAll("-", " ");
}

// How it was heard, and what became of it.
function explained(entry, own) {
  const { heard_as, certainty, slowed, dropped, notes, reason, steps } = entry.answer;
  const parts = [];
  if (reason) parts.push(reason);
  if (heard_as && heard_as !== entry.text && !entry.stick) {
    parts.push(`heard as ${plain(heard_as)}${certainty ? ` (${Math.round(100 * certainty)} % sure)` : ""}`);
  }
  if (slowed) parts.push(`slowed to ${slowed}`);
  if (dropped?.length) parts.push(`not done: ${dropped.join(", ")}`);
  parts.push(...(notes ?? []));
  for (const step of steps ?? []) if (step.end) parts.push(`${plain(step.heard_as)}: ${step.end}`);
  if (entry.source && entry.source !== own) parts.push(`from ${entry.source}`);
  return parts.join("; ");
}

// What was asked: the prompt, the stick, and the history with what was heard.

import { mark, told } from "./answers.js";
import { Ends } from "./ends.js";
import { Strip } from "./strip.js";
import { made } from "./words.js";

const SUGGESTIONS = ["walk forward", "wave", "turn left 90 degrees", "two steps back, then bow", "raise both arms"];
const KEPT = 40, LISTED = 12;
const FOLLOWED = ["accepted", "slowed", "moved", "partly"];
const VELOCITY = /^velocity \[/;
const DRAGGED = /^(left|right) hand to \[/;
const STILL = "stand still"; // what a velocity of zero is called
const HINT = "What should the robot do?";

export class Asked {
  constructor(link) {
    this.link = link;
    this.entries = []; // newest first: {key, text, source, state, answer, at_s}
    this.items = new Map(); // of the list, by entry
    this.list = document.getElementById("history");
    this.said = document.getElementById("said");
    this.ends = new Ends();
    this.strip = new Strip(document.getElementById("timeline"));
    this.prompt = document.getElementById("prompt");
    this.asking = document.querySelectorAll("aside fieldset");
    this.kinds = []; // of motion that the model can do
    this.past = [];
    this.place = 0;
    document.getElementById("ask").onsubmit = (event) => { event.preventDefault(); this.ask(this.prompt.value); };
    this.prompt.addEventListener("keydown", (event) => this.recall(event));
    this.list.addEventListener("scroll", () => this.fade());
    document.getElementById("suggestions").append(...SUGGESTIONS.map((text) => this.chip(text)));
    this.allow("Connecting");
  }

  // Targets can be asked for; else `reason` says why not.
  allow(reason) {
    for (const part of this.asking) part.disabled = Boolean(reason);
    this.prompt.placeholder = reason || HINT;
    if (reason && this.entries[0]) this.entries[0].held = false;
  }

  // A connection is made: the run tells its answers anew.
  begin() {
    this.entries = this.entries.filter((one) => one.key === null && one.state !== "wait");
    this.ends.begin();
    this.strip.begin();
    this.show();
  }

  // A message of the loop.
  happened(event) {
    this.ends.happened(event);
    this.strip.happened(event);
    this.show();
  }

  // The connection is lost; the run was at this time [s].
  lost(time_s) {
    this.ends.lost(time_s);
    this.show();
  }

  async ask(words) {
    const text = words.trim();
    if (!text) return;
    this.prompt.value = "";
    this.past.push(text);
    this.place = this.past.length;
    const { state } = await this.send({ type: "text", text }, text);
    // It may be below the edge, and what to try instead with it.
    if (state === "refused") this.items.get(this.entries.find((one) => one.text === text))?.item.scrollIntoView({ block: "nearest" });
  }

  // Send a target, told as `text`; resolves to its answer.
  async send(message, text) {
    const entry = this.add({ key: null, text, source: this.link.source, state: "wait", answer: {}, goal: message.type !== "text" });
    const answer = await this.link.send(message);
    Object.assign(entry, { state: answer.state, answer: { ...entry.answer, ...answer }, key: answer.target ?? null });
    this.merge(entry);
    this.show();
    this.said.textContent = `${text}: ${mark(entry)[0]}${answer.reason ? `, ${answer.reason}` : ""}`;
    return answer;
  }

  // Send a velocity of the stick. All of them while it is held are one entry, whatever became of each.
  async steer(message) {
    const moves = message.velocity.some((value) => value);
    let entry = this.entries[0]?.held ? this.entries[0] : null;
    if (moves) entry ??= this.add({ key: null, text: "stick", stick: true, held: true, source: this.link.source, state: "wait", answer: {} });
    else if (entry) entry.held = false;
    const answer = await this.link.send(message);
    if (entry?.state === "wait" && ["refused", "expired"].includes(answer.state)) {
      Object.assign(entry, { state: answer.state, answer });
      this.show();
    }
  }

  // Send a place of a hand that is dragged. All of one hand's, one after the other, are one entry.
  async drag(message) {
    const text = `${message.side} hand, dragged`;
    let entry = this.entries[0]?.text === text ? this.entries[0] : null;
    entry ??= this.add({ key: null, text, source: this.link.source, state: "wait", answer: {}, goal: true });
    const { state, reason, moved, target } = await this.link.send(message);
    if (state === "superseded") return;
    Object.assign(entry, { state, answer: { reason, moved }, key: target ?? null });
    this.show();
  }

  // The answer to a target of anyone; a later version of one says how its steps ended.
  heard(message) {
    const key = message.id || `item ${message.item}`;
    if (VELOCITY.test(message.asked)) return this.steered(message, key);
    // Its own dragged hands are told by `drag`.
    if (message.source === this.link.source && DRAGGED.test(message.asked)) return;
    // A run stands until somebody asks for something; nobody has typed that.
    if (message.item !== undefined && message.heard_as === "stand") return;
    let entry = this.entries.find((one) => one.key === key);
    if (!entry && message.source === this.link.source) {
      // Its own answer comes over the same connection and may be later than this.
      entry = this.entries.find((one) => one.key === null && one.state === "wait" && one.text === message.asked);
    }
    if (!entry && message.asked === STILL) {
      const stick = this.entries.find((one) => one.stick && one.source === message.source && !one.ended);
      if (stick) return this.released(stick, message);
    }
    entry ??= this.add({ key, text: message.asked, source: message.source });
    Object.assign(entry, { key, state: message.state, answer: message, at_s: message.at_s ?? entry.at_s });
    this.show();
  }

  // The answer to one velocity of many: one that another velocity replaced is none of the stick's.
  steered({ source, state, slowed, reason, at_s }, key) {
    let entry = this.entries.find((one) => one.stick && one.source === source && one.end_s === undefined);
    if (!FOLLOWED.includes(state)) {
      if (entry?.state === "wait" && state !== "superseded") Object.assign(entry, { state, answer: { reason }, key });
    } else {
      const own = source === this.link.source;
      if (!entry || !(own || entry === this.entries[0])) {
        entry = this.add({ text: "stick", stick: true, source });
      }
      Object.assign(entry, { key, state, answer: { slowed }, at_s: entry.at_s ?? at_s, last_s: at_s });
    }
    this.show();
  }

  // The answer to the stand that a stick asks for when it is let go.
  released(entry, { state, at_s }) {
    if (FOLLOWED.includes(state)) Object.assign(entry, { end_s: at_s, held: false });
    this.show();
  }

  add(entry) {
    this.entries.unshift(entry);
    this.entries.length = Math.min(this.entries.length, KEPT);
    if (entry.answer) this.show();
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

  // Only entries that have changed are made anew: what has the focus, or is unfolded, stays.
  show() {
    this.ends.tell(this.entries);
    const listed = this.entries.slice(0, LISTED);
    for (const [entry, { item }] of this.items) {
      if (listed.includes(entry)) continue;
      item.remove();
      this.items.delete(entry);
    }
    listed.forEach((entry, index) => {
      const content = { text: entry.text, mark: mark(entry), ...told(entry, this.link.source, this.kinds) };
      const known = this.items.get(entry) ?? { item: document.createElement("li"), shown: "" };
      const shown = JSON.stringify(content);
      if (known.shown !== shown) known.item.replaceChildren(...this.parts(content));
      this.items.set(entry, { item: known.item, shown });
      if (this.list.children[index] !== known.item) this.list.insertBefore(known.item, this.list.children[index] ?? null);
    });
    document.getElementById("nothing").hidden = listed.length > 0;
    this.fade();
  }

  parts({ text, mark: [words, kind], steps, notes, problem, tries, more }) {
    const found = [made("b", text), made("span", words, `mark ${kind}`)];
    if (problem) found.push(made("p", problem, "why"));
    if (tries.length) {
      const chips = made("div", "", "chips");
      chips.append(made("span", "Try:"), ...tries.map((one) => this.chip(one)));
      found.push(chips);
    }
    if (steps.length) {
      const list = made("p", "", "steps");
      list.append(...steps.map((step, index) => {
        const one = made("span", `${steps.length > 1 ? `${index + 1}. ` : ""}${step.text}`, step.done ? "done" : "");
        if (step.end) one.append(" ", made("i", step.end));
        return one;
      }));
      found.push(list);
    }
    if (notes.length) found.push(made("p", notes.join("; ")));
    if (more) {
      const folded = document.createElement("details");
      folded.append(made("summary", tries.length || problem.includes("stands still") ? "All motions that it can do" : "More"), document.createTextNode(more));
      found.push(folded);
    }
    return found;
  }

  chip(text) {
    const chip = made("button", text);
    chip.type = "button";
    chip.onclick = () => this.ask(text);
    return chip;
  }

  // The list goes on below its edge.
  fade() {
    const { scrollHeight, scrollTop, clientHeight } = this.list;
    this.list.classList.toggle("more", scrollHeight - scrollTop - clientHeight > 4);
  }

  draw(now_s) {
    this.strip.draw(this.entries, now_s);
  }
}

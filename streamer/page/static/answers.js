// An entry of the history in words: its mark, its steps, and why something was not done.

import { amount, plain } from "./words.js";

const UNSURE = 0.7; // share of a kind of motion below which another one may have been meant
const LONGEST = 160; // characters of a reason that is not folded
const MARKS = {
  accepted: ["accepted", "good"], slowed: ["accepted", "good"], moved: ["accepted", "good"], partly: ["in part", "warn"], done: ["done", "good"], late: ["not finished", "warn"],
  refused: ["refused", "bad"], expired: ["too late", "bad"], superseded: ["replaced", "wait"], stopped: ["stopped", "warn"], wait: ["sent", "wait"],
  unsure: ["unsure", "warn"], ended: ["ended", "wait"],
};
const ENDS = { done: "✓", "time limit": "not finished", superseded: "replaced", stopped: "stopped", expired: "ended" };
const FOLLOWED = ["accepted", "slowed", "moved"];

// [words, kind] of the mark beside an entry.
export function mark(entry) {
  return MARKS[outcome(entry)] ?? [entry.state, "wait"];
}

// What became of it: the robot has measured the steps that have an amount; of the others `ended` tells.
function outcome({ state, answer, text, ended }) {
  if (!FOLLOWED.includes(state)) return state;
  const ends = (answer.steps ?? []).filter((step) => step.amount !== undefined || step.end).map((step) => step.end);
  if (ends.length && ends.every(Boolean)) {
    if (ends.every((end) => end === "done")) return "done";
    if (ends.includes("time limit")) return "late";
    if (ends.includes("expired")) return "ended";
    return ends.includes("stopped") ? "stopped" : ended?.[1] || "superseded";
  }
  if (ended?.[1]) return ended[1];
  return answer.certainty < UNSURE && answer.heard_as && plain(answer.heard_as) !== text ? "unsure" : state;
}

// {steps: [{text, end, done}], notes: [text], problem, tries: [text], more: text} of an entry; `kinds`: all that the model can do.
export function told(entry, own, kinds = []) {
  const { heard_as, manner, certainty, slowed, moved, dropped, notes, reason, steps = [] } = entry.answer;
  const found = { steps: [], notes: [], problem: "", tries: [], more: "" };
  if (reason) Object.assign(found, why(reason, kinds, entry.broke));
  if (steps.length > 1 || steps.some((step) => step.amount !== undefined)) {
    found.steps = steps.map((step) => ({
      text: [mannered(withGesture(step), step.manner), step.amount === undefined ? "" : amount(step.amount, step.unit)].filter(Boolean).join(" "),
      end: ENDS[step.end] ?? "", done: step.end === "done",
    }));
  } else if (heard_as && plain(heard_as) !== entry.text && !entry.stick && !entry.goal) {
    found.notes.push(`heard as ${mannered(heard_as, manner)}${certainty < UNSURE ? ", but not sure" : ""}`);
  }
  if (dropped?.length) found.notes.push(`not done: ${dropped.join(", ")}`);
  if (slowed) found.notes.push(`slowed to ${slowed}`);
  if (moved) found.notes.push(`moved to ${moved}`);
  found.notes.push(...(notes ?? []));
  if (entry.source && entry.source !== own) found.notes.push(`by ${entry.source}`);
  return found;
}

// The motion of a step, with the gesture that is made meanwhile.
function withGesture({ heard_as, text, beside }) {
  return [heard_as ?? text, ...(beside ? [beside] : [])].join(" with ");
}

// A kind of motion, in its manner.
function mannered(heard_as, manner) {
  return [plain(heard_as), ...(manner ? [manner] : [])].join(", ");
}

// A reason; where it names what the model can do, that apart, and what to try instead. broke: the entry that it ended.
function why(reason, kinds, broke) {
  const list = reason.match(/^(.*?)(?:, it|; the model) stands still(?:; try: (.*?))?; it can: (.*)$/);
  if (list) {
    const more = kinds.length ? kinds.map(plain).join(", ") : list[3];
    return { problem: `${list[1]}. ${broke ? `It stopped ${motion(broke)}.` : "The robot stands still."}`, more, tries: list[2]?.split(", ") ?? [] };
  }
  const end = reason.indexOf("; ");
  return reason.length <= LONGEST || end < 0 ? { problem: reason } : { problem: reason.slice(0, end), more: reason.slice(end + 2) };
}

// What a robot did that followed an entry.
function motion({ stick, answer }) {
  const kind = answer.heard_as ?? "";
  if (stick || /walk|velocity|waypoint/.test(kind)) return "walking";
  return /turn|heading/.test(kind) ? "turning" : "what it did";
}

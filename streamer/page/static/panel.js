// The panel over the picture: what has happened, and what to do next. It lies over the picture, so that nothing moves
// when it comes and goes.

import { coded } from "./words.js";

const KINDS = ["press", "lost", "fault", "state"]; // the most urgent first
const TOLD_MS = 2000;
const FAULTED = "Fault: clear it once it has parked";

export class Panel {
  constructor() {
    const [box, title, text, note] = ["alarm", "alarm-title", "alarm-text", "note"].map((id) => document.getElementById(id));
    Object.assign(this, { box, title, text, note, timer: null });
    this.known = new Map(); // by kind: [title, text]
  }

  // Show something of a kind; title null: nothing of this kind.
  show(kind, title, text = "") {
    if (title) this.known.set(kind, [title, text]);
    else this.known.delete(kind);
    const first = KINDS.find((one) => this.known.has(one));
    this.box.hidden = !first;
    this.box.dataset.kind = first ?? "";
    const shown = first ? this.known.get(first) : ["", ""];
    // An alert that is written again is read out again.
    if (this.title.textContent !== shown[0]) this.title.textContent = shown[0];
    if (this.text.dataset.told !== shown[1]) {
      this.text.dataset.told = shown[1];
      this.text.replaceChildren(...coded(shown[1]));
    }
  }

  // Confirm something for a moment.
  tell(message, forMs = TOLD_MS) {
    this.note.textContent = message;
    this.note.hidden = false;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => { this.note.hidden = true; }, forMs);
  }
}

// What to do in a state: [title, text]; null: nothing. other: the operator, if it is not this page.
export function nextStep({ state, must_stop, gets_up_from }, recovering, other) {
  const arm = "See that nobody is in its way, then arm it: it stands up.";
  if (state === "GET_UP") return ["Getting up", "Keep away from it. STOP makes it give way."];
  if (gets_up_from && recovering) return ["It lies", `Put it up by hand, clear the fault, then arm it; or let it get up from its ${gets_up_from}.`];
  if (state === "FAULT") return ["Fault", "The torque is off. Clear the fault, then arm the robot."];
  if (state === "DAMPED") return ["The robot fell", "It gives way, then its torque goes off."];
  if (state === "PARK") return ["Lowering itself", "Then its torque goes off."];
  if (state === "OFF" && must_stop) return ["Stopped", "The torque is off. Release the stop, then arm the robot."];
  if (state === "OFF") return [recovering ? "Fault cleared" : "Torque is off", arm];
  if (recovering) return ["Fault", "The robot lowers itself, then its torque goes off."];
  if (!must_stop) return null;
  return state === "STREAMING" ? ["Stopping", "The robot comes to a stand."] : ["Stopped", `It takes no target until the stop is released.${other ? ` ${other} steers: take over, then release it.` : ""}`];
}

// Why nothing can be asked for now; null: it can.
export function whyNot({ state, must_stop, loop, cause }, other) {
  if (loop === "silent") return state ? "The run has ended" : "The run is starting";
  const reasons = {
    OFF: "Torque is off: arm it first", PARK: "Lowering itself: arm it then",
    GET_UP: "Getting up: wait until it stands", DAMPED: "The robot fell", FAULT: "Fault: clear it first",
  };
  if (cause && (must_stop || state === "PARK") && !["OFF", "FAULT", "DAMPED", "GET_UP"].includes(state)) return FAULTED;
  if (state === "OFF" && must_stop) return "Torque is off: release the stop, then arm it";
  if (reasons[state]) return reasons[state];
  if (must_stop) return "Stopped: release the stop first";
  return other ? `${other} steers: take over first` : null;
}

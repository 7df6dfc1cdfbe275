// How and when what was asked for ended, where its own steps do not tell: by what came after it, and by the loop's messages.

const MOVES = ["READY", "STREAMING", "HOLD"]; // states in which something can be followed
const PRESSES = { STOP: "stopped", ESTOP: "ended", KILL: "ended" };
const PART = /^((left|right) (hand|arm|foot)|head( place)?|both feet|relax|(joint|torque|tension) .*)$/; // beside what the whole body does
const RESTRICTION = /foot$|feet$|^(torque|tension) /; // STOP does not end it
const KEPT = 60;

export class Ends {
  constructor() {
    this.begin();
  }

  // A connection is made: what has happened is told anew.
  begin() {
    this.cuts = []; // [s, how]: whatever was followed was over
    this.rests = []; // when the robot had come to a stand [s]
  }

  // A message of the loop at a time of the run [s].
  happened({ time_s, kind, message }) {
    if (kind === "request" && message in PRESSES) this.cuts.push([time_s, PRESSES[message]]);
    const [, from, to] = message.match(/^([A-Z_]+) -> ([A-Z_]+)/) ?? [];
    if (from === "STREAMING" && to === "HOLD") this.rests.push(time_s);
    if (to && !MOVES.includes(to)) this.cuts.push([time_s, "ended"]);
    for (const list of [this.cuts, this.rests]) if (list.length > KEPT) list.shift();
  }

  // Nothing is known after this time [s].
  lost(time_s) {
    this.cuts.push([time_s, ""]);
  }

  // Tell each entry how and when it ended: `ended` [s, how], and `broke`, the entry whose motion its refusal ended.
  tell(entries) {
    const placed = entries.filter((one) => Number.isFinite(one.at_s) && !isPart(one)).sort((a, b) => a.at_s - b.at_s);
    for (const entry of entries) Object.assign(entry, { ended: isPart(entry) ? this.first(entry, []) : null, broke: null });
    placed.forEach((entry, index) => {
      const next = placed[index + 1], by = next?.state === "refused" ? "ended" : "superseded";
      const ends = next ? [[next.at_s, by]] : [];
      if (entry.end_s !== undefined) ends.push([entry.end_s, "ended"]);
      const steps = entry.answer.steps ?? [];
      if (!steps.some((step) => step.amount !== undefined)) ends.push(...this.rests.map((time_s) => [time_s, stands(entry) ? "done" : "ended"]));
      if (steps.length && steps.every((step) => Number.isFinite(step.end_s))) {
        ends.push([Math.max(...steps.map((step) => step.end_s)), steps.at(-1).end === "superseded" ? by : ""]);
      }
      entry.ended = this.first(entry, ends);
      const cut = steps.at(-1)?.end === "superseded" || (next && entry.ended?.[0] === next.at_s);
      if (next && by === "ended" && cut && entry.state !== "refused" && !stands(entry)) next.broke = entry;
    });
  }

  // The first of these ends, or of those of everything, after the newest message of an entry.
  first(entry, ends) {
    const cuts = RESTRICTION.test(entry.answer?.heard_as ?? "") ? this.cuts.filter(([, how]) => how !== "stopped") : this.cuts;
    const later = [...ends, ...cuts].filter(([time_s]) => time_s > (entry.last_s ?? entry.at_s));
    return later.length ? later.reduce((a, b) => (b[0] < a[0] ? b : a)) : null;
  }
}

function isPart({ answer }) {
  return PART.test(answer?.heard_as ?? "");
}

function stands({ answer }) {
  return answer.heard_as === "stand";
}

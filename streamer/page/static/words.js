// What the run tells, in words for a person.

// A kind of motion: "walk-back" is "walk back".
export function plain(kind) {
  return kind.replaceAll("-", " ");
}

// An amount with its unit, as answers and reports name it: "90°", "2 steps", "1.5 m".
export function amount(value, unit) {
  if (unit === "angle") return `${Math.round((value * 180) / Math.PI)}°`;
  const number = Number(value.toPrecision(3));
  const name = { length: "m", time: "s", steps: "step", times: "time" }[unit] ?? unit;
  return `${number} ${name}${["steps", "times"].includes(unit) && number !== 1 ? "s" : ""}`;
}

// A velocity [m/s ahead, m/s left, rad/s left].
export function direction([ahead, left, turning]) {
  const parts = [
    ahead > 0 ? "ahead" : ahead < 0 ? "back" : "",
    left > 0 ? "to the left" : left < 0 ? "to the right" : "",
    turning > 0 ? "turning left" : turning < 0 ? "turning right" : "",
  ];
  return parts.filter(Boolean).join(", ");
}

// What the robot does now, from the status of the run; "" where it does nothing that anybody asked for.
export function doing({ state, following }, own) {
  if (state !== "STREAMING" || !following) return "";
  const { asked, source, end, heard_as } = following;
  const stands = end || asked.stop || heard_as === "stand" || (asked.velocity && !direction(asked.velocity));
  if (stands) return "coming to a stand";
  if (asked.velocity) return `by ${source === own ? "stick" : source}: ${direction(asked.velocity)}`;
  if (asked.waypoint) return "walking to the chosen place";
  if (asked.heading) return "turning to a heading";
  return asked.clip ? `clip ${asked.clip}` : `“${asked.text}”`;
}

// Text whose parts between backticks are code.
export function coded(text) {
  return text.split("`").map((part, index) => (index % 2 ? made("code", part) : document.createTextNode(part)));
}

// An element with a text.
export function made(tag, text, kind = "") {
  const element = document.createElement(tag);
  element.textContent = text;
  if (kind) element.className = kind;
  return element;
}

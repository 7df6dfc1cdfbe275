// Curves of the last half minute.

const SHOWN_S = 30;
const CURVES = [
  { name: "tracking_deg", title: "tracking error of the joints", unit: "°", digits: 1, most: 5 },
  { name: "load", title: "hardest joint, of its envelope", unit: "%", digits: 0, most: 1.5, scale: 100, limit: 1, limited: "its envelope: 100 %" },
  { name: "margin_mm", title: "balance: distance to the soles' edge", unit: "mm", digits: 0, least: 0, most: 80, limit: 0, limited: "the soles' edge" },
  { name: "late_ms", title: "loop: longest period's work and delay", unit: "ms", digits: 1, most: 8, limit: 8, limited: "a period" },
];

export class Curves {
  constructor(periodMs) {
    this.samples = [];
    this.names = [];
    Object.assign(CURVES[3], { limit: periodMs, most: 1.5 * periodMs, limited: `a period: ${periodMs.toFixed(1)} ms` });
    const root = document.getElementById("curves");
    root.replaceChildren();
    this.parts = CURVES.map((curve) => {
      const row = document.createElement("div");
      row.className = "curve";
      const [title, value, canvas] = ["span", "b", "canvas"].map((tag) => document.createElement(tag));
      title.textContent = curve.title;
      row.append(title, value, canvas);
      root.append(row);
      return { ...curve, value, canvas };
    });
  }

  take(message) {
    if (message.begin) this.samples = [];
    this.names = message.names ?? this.names;
    this.samples.push(...message.samples);
    const newest = this.samples.at(-1)?.[0] ?? 0;
    while (this.samples.length && this.samples[0][0] < newest - SHOWN_S) this.samples.shift();
  }

  draw() {
    if (!this.parts[0].canvas.clientWidth) return; // folded away
    const style = getComputedStyle(document.documentElement);
    const [ink, line, bad] = ["--accent", "--line", "--bad"].map((name) => style.getPropertyValue(name));
    const end = this.samples.at(-1)?.[0] ?? 0;
    for (const part of this.parts) {
      const column = this.names.indexOf(part.name);
      const values = this.samples.map((sample) => sample[column]);
      const known = values.filter((value) => value !== null && value !== undefined);
      const last = values.at(-1);
      part.value.textContent = known.length && last !== null ? `${(last * (part.scale ?? 1)).toFixed(part.digits)} ${part.unit}` : "–";
      const [context, width, height] = fitted(part.canvas);
      const most = Math.max(part.most, ...known), least = Math.min(part.least ?? 0, ...known);
      const x = (time) => width * (1 - (end - time) / SHOWN_S);
      const y = (value) => height - 2 - (height - 4) * (value - least) / (most - least || 1);
      context.strokeStyle = line;
      rule(context, width, y(0));
      if (part.limited) limit(context, width, y(part.limit), part.limited, bad);
      context.strokeStyle = ink;
      context.lineWidth = 1.6;
      context.beginPath();
      let drawing = false;
      values.forEach((value, index) => {
        if (value === null || value === undefined) { drawing = false; return; }
        const place = [x(this.samples[index][0]), y(value)];
        if (drawing) context.lineTo(...place); else context.moveTo(...place);
        drawing = true;
      });
      context.stroke();
    }
  }
}

// A dashed line with its name above it, or below it where there is no room.
function limit(context, width, y, name, colour) {
  context.strokeStyle = context.fillStyle = colour;
  context.setLineDash([3, 3]);
  rule(context, width, y);
  context.setLineDash([]);
  context.font = "11px system-ui, sans-serif";
  context.textBaseline = y < 14 ? "top" : "bottom";
  context.fillText(name, 0, y < 14 ? y + 2 : y - 1);
}

function rule(context, width, y) {
  context.beginPath();
  context.moveTo(0, y);
  context.lineTo(width, y);
  context.stroke();
}

// The context of a canvas in CSS pixels, cleared, with its width and height.
export function fitted(canvas) {
  const ratio = devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return [context, width, height];
}

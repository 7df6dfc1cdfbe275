// What holds beside what the whole body does: parts at places of their own, and restrictions; each can be let go.

import { made } from "./words.js";

export class Holding {
  // list: an element for it; asked: sends what lets go.
  constructor(list, asked) {
    Object.assign(this, { list, asked, known: "[]" });
  }

  show(holding = []) {
    const now = JSON.stringify(holding);
    if (now === this.known) return; // a button that is being pressed stays
    this.known = now;
    this.list.hidden = !holding.length;
    this.list.replaceChildren(...holding.map((one) => this.line(one)));
  }

  line({ parts, asked, restricts, there, missed }) {
    const line = made("li", ""), button = made("button", "Let go", "plain");
    button.type = "button";
    button.setAttribute("aria-label", `Let go: ${parts.join(", ")}`);
    // A cap of both knees names two joints, and each is let go by its own name.
    button.onclick = () => parts.forEach((name) => this.asked.send({ type: "relax", part: name }, `let go: ${name}`));
    const way = there ? "there" : missed ? `not there: ${missed}` : "on its way";
    line.append(made("span", restricts ? asked : `${asked} · ${way}`), button);
    return line;
  }
}

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

  line({ part, asked, restricts, there }) {
    const line = made("li", ""), button = made("button", "Let go", "plain");
    button.type = "button";
    button.setAttribute("aria-label", `Let go: ${part}`);
    // A cap of both knees names two joints, and each is let go by its own name.
    button.onclick = () => part.split(", ").forEach((name) => this.asked.send({ type: "relax", part: name }, `let go: ${name}`));
    line.append(made("span", `${asked}${restricts ? "" : there ? " · there" : " · on its way"}`), button);
    return line;
  }
}

// What restricts the robot, whatever it is told, until it is let go: feet that stay on the ground, capped torques, soft arms.

const JOINTS = ["knee", "hip", "ankle", "shoulder", "elbow"]; // of every humanoid, by the names of the body
const SIDES = { "": "both", "left ": "left", "right ": "right" };

const element = (id) => document.getElementById(id);

export class Restrictions {
  // asked: sends them.
  constructor(asked) {
    this.asked = asked;
    const names = JOINTS.flatMap((joint) => Object.entries(SIDES).map(([side, word]) => new Option(`${word} ${joint}${side ? "" : "s"}`, `${side}${joint}`)));
    element("capped").replaceChildren(...names);
    this.on("keep", () => {
      const foot = element("foot");
      return [{ type: "contact", foot: foot.value }, `keep ${foot.selectedOptions[0].text} on the ground`];
    });
    this.on("cap", () => {
      const limit_nm = element("limit").valueAsNumber, joint = element("capped");
      return [{ type: "torque", joint: joint.value, limit_nm }, `no more than ${limit_nm} N·m at ${joint.selectedOptions[0].text}`];
    });
    this.on("tense", () => {
      const limb = element("limb"), tension = element("tension");
      return [{ type: "tension", limb: limb.value, tension: Number(tension.value) }, `let ${limb.selectedOptions[0].text} ${tension.selectedOptions[0].text}`];
    });
    this.on("relax", () => [{ type: "relax", part: "all" }, "let everything go"]);
  }

  // A form that sends what `target` gives: a message, and how it is told.
  on(id, target) {
    element(id).onsubmit = (event) => {
      event.preventDefault();
      this.asked.send(...target());
    };
  }
}

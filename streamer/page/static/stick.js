// The stick: a velocity while it is held, a stand when it is released.

const EVERY_MS = 100;
const HOLDS_S = 0.5;
const DEAD = 0.12;
const STEPS = 10; // small movements of the hand make no new plan
const KEYS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };

export class Stick {
  // send(message): sends a velocity; pace(): [ahead, back, aside, turning] at full deflection, in a human's speed.
  constructor(send, pace) {
    this.send = send;
    this.allowed = false;
    this.pace = pace;
    this.pad = document.getElementById("stick");
    this.knob = document.getElementById("knob");
    this.pressed = new Set();
    this.timer = null;
    this.pad.addEventListener("pointerdown", (event) => { this.pad.setPointerCapture(event.pointerId); this.hold(event); });
    this.pad.addEventListener("pointermove", (event) => { if (this.pad.hasPointerCapture(event.pointerId)) this.hold(event); });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) this.pad.addEventListener(end, () => this.release());
    // A press on what is selected would drag it, and let the stick go.
    for (const begin of ["dragstart", "selectstart"]) this.pad.addEventListener(begin, (event) => event.preventDefault());
    this.pad.addEventListener("keydown", (event) => this.key(event, true));
    this.pad.addEventListener("keyup", (event) => this.key(event, false));
    this.pad.addEventListener("blur", () => this.release());
    document.addEventListener("visibilitychange", () => { if (document.hidden) this.release(); });
  }

  // Whether the robot takes velocities now. Where it does not, it is not sent the stand of a stick that is let go either.
  allow(allowed) {
    if (!allowed) this.drop();
    this.allowed = allowed;
    this.pad.classList.toggle("off", !allowed);
  }

  hold(event) {
    const box = this.pad.getBoundingClientRect();
    const reach = (box.width - this.knob.clientWidth) / 2;
    const x = (event.clientX - box.left - box.width / 2) / reach;
    const y = (box.top + box.height / 2 - event.clientY) / reach;
    const length = Math.max(Math.hypot(x, y), 1);
    this.deflect(x / length, y / length);
  }

  key(event, down) {
    if (!(event.key in KEYS) || !this.allowed) return;
    event.preventDefault();
    if (down) this.pressed.add(event.key); else this.pressed.delete(event.key);
    if (!this.pressed.size) return this.release();
    const [x, y] = [...this.pressed].map((key) => KEYS[key]).reduce((a, b) => [a[0] + b[0], a[1] + b[1]]);
    this.deflect(x, y);
  }

  deflect(x, y) {
    if (!this.allowed) return;
    this.x = x;
    this.y = y;
    const reach = (this.pad.clientWidth - this.knob.clientWidth) / 2;
    this.knob.style.transform = `translate(${x * reach}px, ${-y * reach}px)`;
    this.pad.classList.add("held");
    if (this.timer === null) {
      this.tell();
      this.timer = setInterval(() => this.tell(), EVERY_MS);
    }
  }

  velocity() {
    const [ahead, back, aside, turning] = this.pace();
    const [x, y] = [rounded(this.x), rounded(this.y)];
    const forward = y * (y > 0 ? ahead : back);
    const turns = document.querySelector("[name=aside]:checked").value === "turn";
    return turns ? [forward, 0, -x * turning] : [forward, -x * aside, 0];
  }

  tell() {
    const velocity = this.velocity();
    if (velocity.some((value) => value)) this.moving = true;
    if (this.moving) this.send({ type: "velocity", velocity, ttl_s: HOLDS_S });
  }

  get held() {
    return this.timer !== null;
  }

  release() {
    const moved = this.held && this.moving;
    this.drop();
    if (moved) this.send({ type: "velocity", velocity: [0, 0, 0] });
  }

  drop() {
    clearInterval(this.timer);
    this.timer = null;
    this.pressed.clear();
    this.pad.classList.remove("held");
    this.knob.style.transform = "";
    this.moving = false;
  }
}

function rounded(value) {
  return Math.abs(value) < DEAD ? 0 : Math.round(value * STEPS) / STEPS;
}

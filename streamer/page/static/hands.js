// Hands that are dragged: a handle at each hand of the robot; where it is dragged to is sent as a target in the trunk's frame.

const GRAB_PX = 24; // how near a pointer has to be to a handle
const EVERY_MS = 100;
const IN_S = 0.25, HOLDS_S = 5, FARTHEST_M = 2;
const SIDES = ["left", "right"];

export class Hands {
  // area: the element around the canvas; scene: draws the handles; asked: sends the targets.
  constructor(area, scene, asked) {
    Object.assign(this, { area, scene, asked, allowed: false, side: null, place: null, sent: null, waits: false });
    // Before the canvas sees it, which would turn the view, or choose a place on the floor.
    area.addEventListener("pointerdown", (event) => this.grab(event), { capture: true });
    area.addEventListener("pointermove", (event) => this.drag(event), { capture: true });
    for (const end of ["pointerup", "pointercancel"]) area.addEventListener(end, (event) => this.release(event), { capture: true });
    setInterval(() => this.tell(), EVERY_MS);
  }

  allow(allowed) {
    this.allowed = allowed;
    if (!allowed) this.drop();
  }

  grab(event) {
    if (!this.allowed || !event.isPrimary || event.button !== 0 || event.target !== this.scene.canvas) return;
    const near = SIDES.map((side, index) => [this.scene.handPixels(index, event.clientX, event.clientY), side]).sort(([a], [b]) => a - b)[0];
    if (!(near[0] <= GRAB_PX)) return;
    event.stopPropagation();
    event.preventDefault();
    this.side = near[1];
    this.pointer = event.pointerId;
    this.area.setPointerCapture(event.pointerId);
  }

  drag(event) {
    if (this.side === null || event.pointerId !== this.pointer) return;
    event.stopPropagation();
    const place = this.scene.handAt(SIDES.indexOf(this.side), event.clientX, event.clientY);
    if (!place?.every((value) => Math.abs(value) <= FARTHEST_M)) return;
    this.place = place;
    this.tell();
  }

  release(event) {
    if (this.side === null || event.pointerId !== this.pointer) return;
    event.stopPropagation();
    this.drop();
  }

  // The last place is still sent.
  drop() {
    this.last = this.side ?? this.last;
    this.side = null;
    this.scene.aim(null);
  }

  // The newest place is sent once the answer to the last one has come, ten times a second at most.
  async tell() {
    const side = this.side ?? this.last;
    if (!this.place || this.waits || performance.now() - (this.sent ?? -Infinity) < EVERY_MS) return;
    const position_m = this.place.map((value) => Number(value.toFixed(4)));
    Object.assign(this, { place: null, sent: performance.now(), waits: true });
    await this.asked.drag({ type: "hand", side, position_m, in_s: IN_S, tolerance_m: FARTHEST_M, ttl_s: HOLDS_S });
    this.waits = false;
  }
}

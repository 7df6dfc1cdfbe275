// A place on the floor to walk to: chosen by a click, or told in metres; sent as a waypoint in the robot's odometry.

const STILL_PX = 6; // a pointer that moves further turns the view

export class Floor {
  // scene: draws the mark and knows where the robot is; asked: sends the waypoint.
  constructor(canvas, scene, asked) {
    this.scene = scene;
    this.asked = asked;
    this.button = document.getElementById("go");
    this.chosen = null; // ahead and left of the robot when it was chosen, and the waypoint [m]
    this.target = null; // number of the waypoint that is walked to
    canvas.addEventListener("pointerdown", (event) => { this.down = event.isPrimary && event.button === 0 ? [event.clientX, event.clientY] : null; });
    canvas.addEventListener("pointerup", (event) => this.up(event));
    this.button.onclick = () => this.go(this.chosen);
    document.getElementById("place").onsubmit = (event) => {
      event.preventDefault();
      this.walk(...["ahead", "left"].map((id) => document.getElementById(id).valueAsNumber));
    };
  }

  up(event) {
    if (!this.down || Math.hypot(event.clientX - this.down[0], event.clientY - this.down[1]) > STILL_PX) return;
    const place = this.scene.floorAt(event.clientX, event.clientY);
    const [ahead, left] = place ? this.scene.fromRobot(place) : [NaN, NaN];
    if (!Number.isFinite(ahead)) return this.forget();
    this.target = null;
    this.choose(place, ahead, left);
    this.button.textContent = `Walk here, ${Math.hypot(ahead, left).toFixed(2)} m`;
    this.button.classList.add("first");
    this.button.hidden = false;
  }

  choose(place, ahead, left) {
    const [x, y, heading] = this.scene.odometry;
    const [cos, sin] = [Math.cos(heading), Math.sin(heading)];
    this.chosen = { ahead, left, position_m: [x + cos * ahead - sin * left, y + sin * ahead + cos * left] };
    this.scene.mark(place);
  }

  // Walk to a place ahead and to the left of the robot [m].
  walk(ahead, left) {
    const place = this.scene.beforeRobot(ahead, left);
    if (!place) return;
    this.choose(place, ahead, left);
    this.go(this.chosen);
  }

  async go({ ahead, left, position_m }) {
    this.button.hidden = true;
    const words = [`${Math.abs(ahead).toFixed(2)} m ${ahead < 0 ? "back" : "ahead"}`, `${Math.abs(left).toFixed(2)} m to the ${left < 0 ? "right" : "left"}`];
    const answer = await this.asked.send({ type: "waypoint", position_m: position_m.map((value) => Number(value.toFixed(3))) }, `walk ${words.join(", ")}`);
    if (["accepted", "slowed"].includes(answer.state)) this.target = answer.target;
    else this.forget();
  }

  // The mark goes when the robot has arrived, or follows something else.
  show({ following, target }) {
    if (this.target === null) return;
    if (target > this.target || (following?.target === this.target && following.end)) this.forget();
  }

  forget() {
    this.chosen = this.target = null;
    this.button.hidden = true;
    this.scene.mark(null);
  }
}

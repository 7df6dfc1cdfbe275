// STOP and emergency stop: over the process of their own, and over the gateway where that does not answer. The way back:
// release, clear, arm; after a fall also: get up.

const PATIENCE_MS = 700;
const SETTLES_MS = 1000; // a button that comes into reach is not pressed by the second half of a double tap
const NAMES = { stop: "STOP", estop: "EMERGENCY STOP", clear: "Clear", arm: "Arm", disarm: "Disarm", getup: "Get up" };
const MESSAGES = { release: { type: "clear" }, getup: { type: "clear", get_up: true } };
const GETS_UP = "The robot gets up by itself now, with all its force. Is nobody within its reach, and nothing in its way?";

export class Stops {
  // alarm(message, advice): shows what was not taken; alarm(null) hides it. tell(message): confirms a press.
  constructor(link, stopPort, alarm, tell) {
    Object.assign(this, { link, stopPort, alarm, tell });
    this.state = null;
    this.recovering = false; // after a fault, until the robot stands again
    this.fell = false; // this fault was a fall
    this.buttons = Object.fromEntries(["release", "clear", "getup", "arm", "disarm"].map((id) => {
      const button = document.getElementById(id);
      button.onclick = () => { if (id !== "getup" || confirm(GETS_UP)) this.ask(id); };
      return [id, { button, timer: null }];
    }));
    const stop = document.getElementById("stop");
    const estop = document.getElementById("estop");
    stop.onclick = () => this.press("stop", stop);
    estop.onclick = () => this.press("estop", estop);
    addEventListener("keydown", (event) => {
      if (event.key === "Escape" && !event.repeat) this.press("stop", stop);
    });
  }

  async press(what, button) {
    button.classList.add("pressed");
    setTimeout(() => button.classList.remove("pressed"), 400);
    const host = location.hostname.includes(":") ? `[${location.hostname}]` : location.hostname;
    try {
      const response = await fetch(`http://${host}:${this.stopPort()}/${what}`, {
        method: "POST", headers: this.link.headers, signal: AbortSignal.timeout(PATIENCE_MS),
      });
      if (!response.ok) throw new Error(String(response.status));
      this.taken(what);
    } catch {
      await this.stopOverGateway(what);
    }
  }

  // Over the gateway. A person who pressed a stop must know that nobody has taken it.
  async stopOverGateway(what) {
    const silence = new Promise((resolve) => setTimeout(() => resolve({ state: "refused", reason: "no answer" }), PATIENCE_MS));
    const answer = await Promise.race([this.link.send({ type: what }), silence]);
    const advice = "Nobody has taken it. Press again; if the robot goes on, switch its supply off.";
    if (answer.state === "accepted") this.taken(what);
    else this.alarm(`${NAMES[what]}: ${answer.reason}`, advice);
  }

  taken(what) {
    this.alarm(null);
    const off = ["OFF", "FAULT"].includes(this.state);
    const until = what === "stop" && this.state === "OFF" ? "the stop is released" : "the fault is cleared";
    this.tell(`${NAMES[what]} received${off ? `: the torque stays off until ${until}` : ""}`);
  }

  async ask(what) {
    const answer = await this.link.send(MESSAGES[what] ?? { type: what });
    if (answer.state === "accepted") this.alarm(null);
    else this.alarm(`${NAMES[what] ?? NAMES.clear}: refused`, answer.reason);
  }

  // After a STOP targets are refused until it is released, and without torque so is arming; after a fault the torque
  // stays off until the fault is cleared and the robot is armed. Both steps are shown while the robot lowers itself.
  show({ state, must_stop, cause, loop, gets_up_from }) {
    this.state = state;
    if (["FAULT", "DAMPED"].includes(state) || (state === "PARK" && cause)) this.recovering = true;
    if (state === "DAMPED" || /^(fall|kill|get up)\b|while it got up/.test(cause ?? "")) this.fell = true;
    if (["READY", "STREAMING", "HOLD"].includes(state)) this.recovering = this.fell = false;
    const risen = state === "GET_UP";
    const silent = loop === "silent";
    const stopped = must_stop && ["OFF", "READY", "STREAMING", "HOLD"].includes(state) && !cause;
    const stands = ["READY", "HOLD"].includes(state) && !must_stop && !cause;
    this.offer("release", !silent && stopped, state !== "STREAMING");
    this.offer("clear", !silent && this.recovering && !risen, state === "FAULT");
    const lies = this.fell && gets_up_from && ["OFF", "FAULT"].includes(state);
    this.offer("getup", !silent && Boolean(lies), true);
    this.offer("arm", !silent && !risen && (this.recovering || ["OFF", "PARK"].includes(state)), state === "OFF" && !must_stop);
    this.offer("disarm", !silent && stands, true);
  }

  // Show a button; it can be pressed once it has been there for a moment.
  offer(name, shown, usable) {
    const known = this.buttons[name];
    const { button } = known;
    button.hidden = !shown;
    if (!shown || !usable) {
      clearTimeout(known.timer);
      known.timer = null;
      button.disabled = true;
    } else if (known.timer === null) {
      button.disabled = true;
      known.timer = setTimeout(() => { button.disabled = false; }, SETTLES_MS);
    }
  }

  // Nothing but the stops can be reached.
  lost() {
    for (const name of Object.keys(this.buttons)) this.offer(name, false, false);
  }
}

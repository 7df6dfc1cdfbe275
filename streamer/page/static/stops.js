// STOP and emergency stop: over the process of their own, and over the gateway where that does not answer.

const PATIENCE_MS = 700;
const NAMES = { stop: "STOP", estop: "EMERGENCY STOP", clear: "Release", arm: "Arm", disarm: "Disarm" };

export class Stops {
  // alarm(message, advice): shows what was not taken; alarm(null) hides it.
  constructor(link, stopPort, alarm) {
    this.link = link;
    this.stopPort = stopPort;
    this.alarm = alarm;
    const stop = document.getElementById("stop");
    const estop = document.getElementById("estop");
    this.clear = document.getElementById("clear");
    this.arm = document.getElementById("arm");
    stop.onclick = () => this.press("stop", stop);
    estop.onclick = () => this.press("estop", estop);
    this.clear.onclick = () => this.ask("clear");
    this.arm.onclick = () => this.ask(this.arm.dataset.asks);
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
      this.alarm(null);
    } catch {
      await this.stopOverGateway(what);
    }
  }

  // Over the gateway. A person who pressed a stop must know that nobody has taken it.
  async stopOverGateway(what) {
    const silence = new Promise((resolve) => setTimeout(() => resolve({ state: "refused", reason: "no answer" }), PATIENCE_MS));
    const answer = await Promise.race([this.link.send({ type: what }), silence]);
    const advice = "Nobody has taken it. Press again; if the robot goes on, switch its supply off.";
    if (answer.state === "accepted") this.alarm(null);
    else this.alarm(`${NAMES[what]}: ${answer.reason}`, advice);
  }

  async ask(what) {
    const answer = await this.link.send({ type: what });
    if (answer.state === "accepted") this.alarm(null);
    else this.alarm(`${NAMES[what]}: refused`, answer.reason);
  }

  // After a STOP targets are refused until it is released; after a fault the torque stays off until it is cleared and the
  // robot is armed.
  show(status) {
    const fault = status.state === "FAULT";
    this.clear.hidden = status.loop === "silent" || !(fault || (status.must_stop && status.state === "HOLD"));
    this.clear.textContent = fault ? "Clear fault" : "Release stop";
    this.clear.classList.add("first");
    const off = status.state === "OFF";
    const stands = ["READY", "HOLD"].includes(status.state) && !status.must_stop;
    this.arm.hidden = status.loop === "silent" || !(off || stands);
    this.arm.dataset.asks = off ? "arm" : "disarm";
    this.arm.textContent = off ? "Arm" : "Disarm";
    this.arm.classList.toggle("first", off);
    this.arm.title = off ? "Switches the torque on: the robot stands up" : "Lowers the robot and switches the torque off";
  }

  // Nothing but the stops can be reached.
  lost() {
    this.clear.hidden = this.arm.hidden = true;
  }
}

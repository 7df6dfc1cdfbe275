// STOP and emergency stop: over the process of their own, and over the gateway where that does not answer.

const PATIENCE_MS = 700;

export class Stops {
  constructor(link, stopPort) {
    this.link = link;
    this.stopPort = stopPort;
    const stop = document.getElementById("stop");
    const estop = document.getElementById("estop");
    this.clear = document.getElementById("clear");
    this.arm = document.getElementById("arm");
    stop.onclick = () => this.press("stop", stop);
    estop.onclick = () => this.press("estop", estop);
    this.clear.onclick = () => this.link.send({ type: "clear" });
    this.arm.onclick = () => this.link.send({ type: this.arm.dataset.asks });
    addEventListener("keydown", (event) => {
      if (event.key === "Escape" && !event.repeat) this.press("stop", stop);
    });
  }

  async press(what, button) {
    button.classList.add("pressed");
    setTimeout(() => button.classList.remove("pressed"), 400);
    try {
      const host = location.hostname.includes(":") ? `[${location.hostname}]` : location.hostname;
      const response = await fetch(`http://${host}:${this.stopPort()}/${what}`, {
        method: "POST", headers: this.link.headers, signal: AbortSignal.timeout(PATIENCE_MS),
      });
      if (!response.ok) throw new Error(String(response.status));
    } catch {
      await this.link.send({ type: what });
    }
  }

  // After a STOP targets are refused until it is released; after a fault the torque stays off until it is cleared and the
  // robot is armed.
  show(status) {
    const fault = status.state === "FAULT";
    this.clear.hidden = !(fault || (status.must_stop && status.state === "HOLD"));
    this.clear.textContent = fault ? "Clear fault" : "Release stop";
    const off = status.state === "OFF";
    const stands = ["READY", "HOLD"].includes(status.state) && !status.must_stop;
    this.arm.hidden = status.loop === "silent" || !(off || stands);
    this.arm.dataset.asks = off ? "arm" : "disarm";
    this.arm.textContent = off ? "Arm" : "Disarm";
    this.arm.title = off ? "Switches the torque on: the robot stands up" : "Lowers the robot and switches the torque off";
  }
}

// The page of a run.

import { Asked } from "./asked.js";
import { Curves } from "./curves.js";
import { Floor } from "./floor.js";
import { Hands } from "./hands.js";
import { Holding } from "./holding.js";
import { Link } from "./link.js";
import { nextStep, Panel, whyNot } from "./panel.js";
import { Restrictions } from "./restrictions.js";
import { Scene } from "./scene.js";
import { Stick } from "./stick.js";
import { Stops } from "./stops.js";
import { amount, coded, doing, made } from "./words.js";

const STATES = {
  OFF: ["torque off", ""], READY: ["standing up", "warn"], STREAMING: ["moving", "good"], HOLD: ["standing", "good"],
  PARK: ["parking", "warn"], DAMPED: ["fallen", "bad"], GET_UP: ["getting up", "warn"],
  FAULT: ["fault, torque off", "bad"],
};
const EVENTS_KEPT = 40;
const element = (id) => document.getElementById(id);

const PICKED_UP = "Simulation: somebody picked the robot up and stood it up again.";
const PICKED_UP_MS = 6000;

const OVER = /^target \d+ is over after/;
const LATE = "The stick's messages came too late, and the robot came to a stand in between: this browser or its network is too slow.";

const late = { times: 0, item: null }; // velocities of the stick whose time was over
let fault = null; // what happened last, and what to do about it
let robot = null, scene = null, floor = null, hands = null, curves = null, status = {}, seen = 0;

const link = new Link({
  open: begin,
  closed: lost,
  refused: askToken,
  picture: (numbers) => { scene?.take(numbers); seen = performance.now(); },
  message: ({ type, ...content }) => ({ status: showStatus, health: showHealth, curves: takeCurves, event: showEvent, heard: (one) => asked.heard(one), lease: () => {} })[type]?.(content),
});
const asked = new Asked(link);
const stick = new Stick((message) => asked.steer(message), () => robot?.pace ?? [0.4, 0.3, 0.2, 0.5]);
new Restrictions(asked);
const holding = new Holding(element("holding"), asked);
const panel = new Panel();
const stops = new Stops(link, () => status.stop_port ?? 8791, (title, text) => panel.show("press", title, text), (message) => panel.tell(message));
for (const card of document.querySelectorAll(".wide-open")) card.open = matchMedia("(min-width: 900px)").matches;

async function start() {
  theme(localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
  try {
    robot = await link.get("/robot");
  } catch {
    lost();
    setTimeout(start, 1500);
    return;
  }
  element("robot").textContent = robot.name;
  element("driver").textContent = robot.driver === "sim" ? "simulated" : robot.driver;
  document.title = `${robot.name} · FlexMotion`;
  curves = new Curves(1000 / robot.rate_hz);
  scene = new Scene(element("scene"), robot);
  const alarm = element("alarm");
  new ResizeObserver(() => scene.cover(alarm.offsetTop + alarm.offsetHeight)).observe(alarm); // 0 while it is hidden
  document.documentElement.classList.toggle("undrawn", !scene.renderer);
  scene.paint();
  scene.pickedUp = () => {
    if (robot.driver === "sim") panel.tell(PICKED_UP, PICKED_UP_MS);
    scene.pickedUp = () => {};
  };
  floor = new Floor(element("scene"), scene, asked);
  hands = new Hands(element("scene").parentElement, scene, asked);
  asked.kinds = robot.kinds;
  element("clips").hidden = !robot.clips.length;
  element("clip").replaceChildren(...robot.clips.map((name) => new Option(name)));
  for (const [id, name] of [["show-plan", "plan"], ["show-human", "human"], ["show-balance", "balance"]]) {
    element(id).onchange = ({ target }) => { scene.shown[name] = target.checked; };
  }
  link.connect();
  requestAnimationFrame(draw);
  setInterval(drawFigures, 200);
  window.flexmotion = { scene, link, asked, floor, hands };
}

function begin() {
  element("events").replaceChildren();
  element("scene").parentElement.classList.remove("lost");
  asked.begin();
  panel.show("lost", null);
}

// The picture, and all figures, are those of the last moment in which the run could be reached.
function lost() {
  pill("no connection", "bad");
  element("scene").parentElement.classList.add("lost");
  stick.allow(false);
  asked.allow("No connection");
  asked.lost(scene?.time ?? 0);
  element("following").textContent = "";
  floor?.forget();
  hands?.allow(false);
  stops.lost();
  panel.show("state", null);
  panel.show("lost", "No connection to the run", "What you see is old. STOP and EMERGENCY STOP go to a process of their own: press them all the same.");
}

element("clips").onsubmit = (event) => {
  event.preventDefault();
  const clip = element("clip").value;
  asked.send({ type: "clip", clip }, clip);
};

// Half of the time at least is left to the stick, whose messages must not be late, also where drawing is slow.
function draw() {
  const begin = performance.now();
  scene.draw();
  setTimeout(() => requestAnimationFrame(draw), performance.now() - begin);
}

function drawFigures() {
  if (document.hidden) return;
  curves.draw();
  asked.draw(scene.time ?? 0);
}

function takeCurves(message) {
  curves?.take(message);
}

function pill(text, kind) {
  element("state").textContent = text;
  element("state").className = `pill ${kind}`;
}

function showStatus(now) {
  const before = status.state;
  status = now;
  const [text, kind] = STATES[now.ready ? "HOLD" : now.state] ?? ["starting", ""];
  const silent = now.loop === "silent";
  const stopped = now.must_stop && ["READY", "HOLD", "STREAMING"].includes(now.state);
  const words = silent ? (now.state ? "run has ended" : "starting") : stopped ? (now.state === "STREAMING" ? "stopping" : "stopped") : text;
  pill(words, silent || stopped ? "warn" : kind);
  stops.show(now);
  element("following").textContent = silent || stopped ? "" : doing(now, link.source);
  const other = now.operator && now.operator !== link.source ? now.operator : null;
  holding.show(now.holding);
  element("operator").textContent = now.operator ? (other ? `operator: ${other}` : "you steer") : "";
  const lease = element("lease");
  lease.hidden = !other;
  if (other) {
    lease.firstElementChild.textContent = `${other} steers the robot.`;
    lease.lastElementChild.onclick = () => link.send({ type: "take" });
  }
  const reason = whyNot(now, other);
  asked.allow(reason);
  stick.allow(!reason);
  hands?.allow(!reason);
  if (scene) scene.powered = !["OFF", "FAULT"].includes(now.state);
  if (reason) floor?.forget(); else floor?.show(now);
  const stands = ["READY", "STREAMING", "HOLD"].includes(now.state) && !now.cause;
  if ((before === "FAULT" && now.state === "OFF") || (stands && now.state !== "HOLD")) fault = null;
  panel.show("fault", ...((stands ? null : fault) ?? [null]));
  panel.show("state", ...((silent ? null : nextStep(now, stops.recovering, other)) ?? [null]));
}

function showEvent(event) {
  const { time_s, kind, message, headline, advice } = event;
  asked.happened(event);
  if (kind === "request" && message === "NOTE") return;
  if (stick.held && OVER.test(message)) return showLate(time_s);
  const item = listed(time_s, message, kind);
  if (advice) {
    item.append(document.createElement("p"));
    item.lastChild.append(...coded(advice));
  }
  if (kind !== "fault" && kind !== "refused" && !(kind === "state" && advice)) return;
  fault = [headline ?? message.replace(/^[A-Z]+ -> [A-Z]+:? ?/, ""), advice ?? "See the messages."];
  panel.show("fault", ...fault);
}

// A line of the messages, the newest first.
function listed(time_s, message, kind) {
  const item = document.createElement("li");
  item.append(made("time", `${time_s.toFixed(1)} s`), made("span", message, kind));
  const list = element("events");
  list.prepend(item);
  while (list.children.length > EVENTS_KEPT) list.lastChild.remove();
  return item;
}

// The time of a velocity was over before the stick, which is held, sent the next one. All of them are one line.
function showLate(time_s) {
  late.times += 1;
  late.item?.remove();
  late.item = listed(time_s, `${LATE} (${amount(late.times, "times")})`, "warning");
}

function showHealth(now) {
  const known = now.temperatures.map((value, joint) => [value, robot.joints[joint]]).filter(([value]) => value !== null);
  const hottest = known.reduce((a, b) => (b[0] > a[0] ? b : a), [-Infinity, ""]);
  const volts = now.voltages.filter((value) => value !== null);
  const limit = robot.temperature_limit;
  list("body", {
    "hottest servo": known.length ? `${hottest[1]}, ${hottest[0].toFixed(0)} °C of ${limit} °C` : "not measured",
    supply: volts.length ? `${Math.min(...volts).toFixed(1)} V${robot.voltage_min ? ` (at least ${robot.voltage_min} V)` : ""}` : "not measured",
  });
  element("hardest").replaceChildren(...now.hardest.map(([joint, share]) => {
    const bar = document.createElement("div");
    bar.className = share > 0.8 ? "bar high" : "bar";
    const name = Object.assign(document.createElement("span"), { textContent: joint });
    const box = document.createElement("i");
    box.append(document.createElement("i"));
    box.firstChild.style.width = `${Math.min(100 * share, 100)}%`;
    const value = Object.assign(document.createElement("b"), { textContent: `${(100 * share).toFixed(0)} %` });
    bar.append(name, box, value);
    return bar;
  }));
  const ms = (value) => (value === null ? "–" : `${value} ms`);
  list("figures", {
    "woke late, median": ms(now.wake_ms[0]), "woke late, 99 of 100 within": ms(now.wake_ms[1]),
    "loop work, median": ms(now.work_ms[0]), "loop work, 99 of 100 within": ms(now.work_ms[1]),
    "sampling, newest": ms(now.sample_ms), "retargeting, newest": ms(now.retarget_ms),
    "target to command, newest": ms(now.target_to_command_ms),
    "number of the tick": status.tick ?? "–", "number of the plan": now.plan,
    "missed periods": now.missed_deadlines, "plans that ran out": now.underruns, "late plans": now.late_plans,
    "goals outside the envelope": now.violations, "steps planned": now.steps_planned, "steps inserted": now.steps_inserted,
    "feet in the air": now.hung ? "yes" : "no",
    ...Object.fromEntries(Object.entries(status.counts ?? {}).map(([name, count]) => [`messages ${name}`, count])),
    "picture's age": seen ? `${Math.round(performance.now() - seen)} ms` : "–",
  });
}

function list(id, values) {
  element(id).replaceChildren(...Object.entries(values).flatMap(([name, value]) => [
    Object.assign(document.createElement("dt"), { textContent: name }),
    Object.assign(document.createElement("dd"), { textContent: value }),
  ]));
}

function theme(name) {
  document.documentElement.dataset.theme = name;
  localStorage.setItem("theme", name);
  scene?.paint();
}
element("theme").onclick = () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");

function askToken() {
  const dialog = element("token");
  if (dialog.open) return;
  dialog.onclose = () => { link.setToken(element("token-text").value.trim()); };
  dialog.showModal();
}

start();

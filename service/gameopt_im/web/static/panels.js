// What stands beside the map: the crossing order, the selected vehicle, the candidates, the banner.

import { drawLines } from "./charts.js";
import { classOf, STATUS_WORDS } from "./glyphs.js";

const MOST_ROWS = 60;
const RECENT_S = 10;
const PAST_S = 15;
const STEP_S = 0.1;

export function slotWords(car) {
  return car.slot_s === null ? "no slot" : `in ${car.slot_s.toFixed(1)} s`;
}

// A listbox whose rows stay the same elements while vehicles come and go, so that focus and scrolling stay.
export class Order {
  constructor(list, counts, select) {
    this.list = list;
    this.counts = counts;
    this.select = select;
    this.rows = new Map();
    list.addEventListener("click", (event) => {
      const row = event.target.closest("li");
      if (row) select(row.dataset.vehicle);
    });
    list.addEventListener("keydown", (event) => this.key(event));
  }

  key(event) {
    const steps = { ArrowDown: 1, ArrowRight: 1, ArrowUp: -1, ArrowLeft: -1, Home: -Infinity, End: Infinity };
    if (event.key === "Escape") return this.select(null);
    if (!(event.key in steps) || !this.shown?.length) return;
    event.preventDefault();
    this.step(steps[event.key]);
  }

  // Selects the vehicle so many turns later than the selected one.
  step(by) {
    const now = this.shown.indexOf(this.selected);
    const next = Math.min(this.shown.length - 1, Math.max(0, now < 0 && by < Infinity ? 0 : now + by));
    if (this.shown[next] !== undefined) this.select(this.shown[next]);
  }

  draw(traffic, selected) {
    const moved = this.selected !== selected;
    this.selected = selected;
    const cars = traffic.inOrder();
    const shown = cars.slice(0, MOST_ROWS);
    this.shown = shown.map((car) => car.vehicle);
    const open = cars.filter((car) => car.status === "waiting" || car.status === "offered").length;
    this.counts.textContent = `${open} waiting · ${cars.length - open} cleared`;
    for (const [vehicle, row] of this.rows) {
      if (this.shown.includes(vehicle)) continue;
      row.remove();
      this.rows.delete(vehicle);
    }
    shown.forEach((car, k) => {
      const row = this.rows.get(car.vehicle) ?? this.made(car);
      if (this.list.children[k] !== row) this.list.insertBefore(row, this.list.children[k] ?? null);
      fillRow(row, car, car.vehicle === selected);
    });
    const active = this.rows.get(selected);
    if (active) this.list.setAttribute("aria-activedescendant", active.id);
    else this.list.removeAttribute("aria-activedescendant");
    if (moved && active) active.scrollIntoView({ block: "nearest" });
  }

  made(car) {
    const row = document.createElement("li");
    row.id = `row-${car.vehicle}`;
    row.dataset.vehicle = car.vehicle;
    row.setAttribute("role", "option");
    row.innerHTML = '<b></b><span class="dot"></span><span class="name"></span><span class="kind"></span><span class="slot"></span>';
    row.querySelector(".name").textContent = car.vehicle;
    row.querySelector(".kind").textContent = classOf(car.vehicle_class);
    this.rows.set(car.vehicle, row);
    return row;
  }
}

function fillRow(row, car, selected) {
  row.children[0].textContent = car.rank + 1;
  row.children[1].className = `dot ${car.status}`;
  row.children[1].title = STATUS_WORDS[car.status];
  row.children[4].textContent = car.slot_s === null ? "–" : slotWords(car);
  row.setAttribute("aria-selected", String(selected));
  row.setAttribute("aria-label", `${car.rank + 1}: ${car.vehicle}, ${STATUS_WORDS[car.status]}, ${slotWords(car)}`);
}

export class Selected {
  constructor(card, select) {
    this.card = card;
    this.card.innerHTML = `<h2>Selected vehicle</h2>
      <p class="hint">Click a vehicle on the map, or choose one in the crossing order with the arrow keys.</p>
      <div class="body" hidden>
        <h3><span class="dot"></span> <span class="name"></span> <button type="button" aria-label="Select none">×</button></h3>
        <p class="status"></p>
        <dl></dl>
        <h4>Speed <small>m/s; dashed: the profile it is cleared for</small></h4>
        <canvas class="profile" role="img" aria-label="Speed of the selected vehicle"></canvas>
        <h4>Master bids <small>by weight vector; ★ the winner's</small></h4>
        <ul class="bids"></ul>
      </div>`;
    this.body = card.querySelector(".body");
    card.querySelector("button").addEventListener("click", () => select(null));
  }

  draw(traffic, selected, hello) {
    const car = traffic.cars.get(selected);
    this.card.querySelector(".hint").hidden = Boolean(car);
    this.body.hidden = !car;
    this.card.dataset.vehicle = car?.vehicle ?? "";
    if (!car) return;
    const detail = traffic.frame.details[selected];
    this.card.querySelector(".dot").className = `dot ${car.status}`;
    this.card.querySelector(".name").textContent = car.vehicle;
    this.card.querySelector(".status").textContent = [
      `${classOf(car.vehicle_class)}, ${STATUS_WORDS[car.status]}`,
      car.silent && "silent", car.fallback && "on its own fallback",
    ].filter(Boolean).join(", ");
    facts(this.card.querySelector("dl"), [
      ["turn", car.rank >= 0 ? `${car.rank + 1} of ${traffic.inOrder().length}` : "–"],
      ["slot", car.slot_s === null ? "–" : slotWords(car)],
      ["speed", `${car.speed_mps.toFixed(1)} m/s`],
      ["to the line", car.distance_m >= 0 ? `${car.distance_m.toFixed(0)} m` : "past it"],
      ["in the zone for", `${car.waited_s.toFixed(0)} s`],
      ["movement", hello.map.movements[car.movement].id],
      ["declared A", detail ? detail.assertiveness.toFixed(2) : "…"],
      ["won with", detail?.bid ? detail.bid.toFixed(4) : "–"],
      [car.status === "waiting" || car.status === "offered" ? "price" : "price paid", this.price(traffic, car)],
    ]);
    if (detail) {
      this.drawProfile(traffic, car, detail);
      this.drawBids(traffic, detail, hello);
    }
  }

  price(traffic, car) {
    if (car.status === "waiting") return "not won yet";
    const price = car.price || traffic.paid.get(car.vehicle);
    if (price === undefined) return car.status === "leaving" ? "–" : (0).toFixed(4);
    return car.status === "offered" ? `${price.toFixed(4)} if taken` : price.toFixed(4);
  }

  drawProfile(traffic, car, detail) {
    const now_s = traffic.frame.time_s;
    const past = (traffic.trails.get(car.vehicle) ?? []).map(([time_s, v]) => [time_s - now_s, v]);
    const ahead = detail.profile_mps.map((v, k) => [k * STEP_S, v]);
    const to = Math.max(10, car.slot_s ?? 0, ahead.length * STEP_S);
    const marks = [[0, "now"], ...(car.slot_s ? [[car.slot_s, "line"]] : [])];
    const shown = past.filter(([time_s]) => time_s >= -PAST_S);
    const most = 5 * Math.ceil(Math.max(15, ...shown.map(([, v]) => v), ...ahead.map(([, v]) => v)) / 5);
    drawLines(this.card.querySelector("canvas"), [shown, ahead], { from: -PAST_S, to, most, marks });
  }

  drawBids(traffic, detail, hello) {
    const list = this.card.querySelector(".bids");
    const won = traffic.frame.contenders.find((each) => each.won)?.number;
    const used = won === undefined ? undefined : Math.max(won, 0);
    if (!detail.bids.length) {
      list.replaceChildren(item("it does not bid any more"));
      return;
    }
    const most = Math.max(...detail.bids, 1e-9);
    list.replaceChildren(...detail.bids.map((bid, k) => {
      const row = item("");
      const bar = document.createElement("progress");
      Object.assign(bar, { max: most, value: Math.max(0, bid) });
      bar.setAttribute("aria-hidden", "true");
      row.append(`${k === used ? "★" : ""}${k + 1}`, bar, bid.toFixed(3));
      row.title = weightWords(hello.weights[k]);
      row.classList.toggle("won", k === used);
      return row;
    }));
  }
}

function item(words) {
  const row = document.createElement("li");
  row.textContent = words;
  return row;
}

function facts(list, pairs) {
  if (list.children.length !== pairs.length) {
    list.replaceChildren(...pairs.map(() => {
      const pair = document.createElement("div");
      pair.append(document.createElement("dt"), document.createElement("dd"));
      return pair;
    }));
  }
  pairs.forEach(([term, told], k) => {
    list.children[k].children[0].textContent = term;
    list.children[k].children[1].textContent = told;
  });
}

function weightWords(weights) {
  return weights ? `time ${weights[0]}, distance ${weights[1]}, waiting ${weights[2]}, assertiveness ${weights[3]}` : "";
}

export class Candidates {
  constructor(section) {
    this.tally = section.querySelector("#tally");
    this.why = section.querySelector("#why");
    this.body = section.querySelector("tbody");
  }

  draw(traffic, hello) {
    const { contenders } = traffic.frame;
    const ordered = [...contenders].sort((one, other) => other.won - one.won || one.cost - other.cost);
    this.tally.textContent = `${contenders.length} this control cycle`;
    this.why.textContent = reason(ordered, hello);
    this.body.replaceChildren(...ordered.map((each) => {
      const row = document.createElement("tr");
      row.className = each.won ? "won" : "";
      const name = cell(`${each.won ? "★ " : ""}${nameOf(each)}`);
      name.title = each.number < 0 ? "the last control cycle's order, with newcomers" : weightWords(hello.weights[each.number]);
      const cost = cell(`${each.solved ? "" : "≥ "}${each.cost.toFixed(2)}`);
      cost.title = each.solved ? `delay ${each.delay_s ?? "–"} s, J ${each.objective ?? "–"}`
        : "its program was not solved: it could not win, or was not done in time";
      const first = cell(each.order.slice(0, 3).map((k) => traffic.list[k]?.vehicle).join(" › "));
      row.append(name, cost, first);
      return row;
    }));
  }
}

function nameOf({ number }) {
  return number < 0 ? "incumbent" : `weights ${number + 1}`;
}

function cell(words) {
  const made = document.createElement("td");
  made.textContent = words;
  return made;
}

function reason([first, second], hello) {
  if (!first) return "Nobody waits to be planned.";
  if (!first.won) return "None was chosen.";
  const by = hello.profile === "paper" ? "objective J" : "predicted weighted delay, with a little of J";
  if (!second) return `${capital(nameOf(first))} is the only order there is.`;
  const lead = (second.cost - first.cost).toFixed(2);
  const bonus = [first, second].some((each) => each.number < 0) && hello.incumbent_bonus && hello.profile !== "paper"
    ? ` The incumbent has a bonus of ${100 * hello.incumbent_bonus} %.` : "";
  return `${capital(nameOf(first))} won: its cost, ${by}, is ${second.solved ? "" : "at least "}${lead} below that of ${nameOf(second)}.${bonus}`;
}

function capital(words) {
  return words[0].toUpperCase() + words.slice(1);
}

// What is wrong just now, in words; nothing when all is well.
export function troubles(traffic, link, nowMs, clock) {
  const found = [];
  if (link === "lost") return ["No connection to the manager; trying again. What is shown is the last that was known."];
  if (!traffic.frame) return found;
  if (clock === "wall" && nowMs - traffic.takenMs > 1500) {
    found.push(`No control cycle for ${((nowMs - traffic.takenMs) / 1000).toFixed(0)} s.`);
  }
  const [missed] = traffic.grown("missed_total", RECENT_S);
  if (missed > 0) found.push(`${count(missed, "control cycle")} missed in the last ${RECENT_S} s.`);
  const naming = [
    ["silent: no fresh state, so their place is a guess", (car) => car.silent],
    ["on their own fallback, without commands", (car) => car.fallback],
    ["in the conflict zone without a clearance", (car) => car.status === "intruding"],
    ["asked to give a clearance back", (car) => car.status === "withdrawn"],
  ];
  for (const [words, holds] of naming) {
    const cars = traffic.list.filter(holds);
    if (!cars.length) continue;
    const names = cars.slice(0, 3).map((car) => car.vehicle).join(", ") + (cars.length > 3 ? ", …" : "");
    found.push(`${count(cars.length, "vehicle")} ${words} (${names}).`);
  }
  return found;
}

function count(n, what) {
  return `${n} ${what}${n === 1 ? "" : "s"}`;
}

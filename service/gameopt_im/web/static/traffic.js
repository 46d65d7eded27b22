// The frames as they come: the newest one, where every vehicle is between two of them, and what was seen before.

const HISTORY_S = 120;
const TRAIL_S = 20;
const MOST_AHEAD = 1.3;

const CAR = ["vehicle", "vehicle_class", "movement", "footprint", "distance_m", "speed_mps", "length_m", "width_m",
  "status", "rank", "slot_s", "waited_s", "silent", "fallback", "price"];

export class Traffic {
  constructor() {
    this.forget();
  }

  forget() {
    this.frame = null;
    this.cars = new Map();
    this.before = new Map();
    this.history = [];
    this.trails = new Map();
    this.paid = new Map();
    this.gapMs = 100;
  }

  take(frame, nowMs) {
    if (this.frame && frame.time_s < this.frame.time_s) this.forget();
    if (this.frame) this.gapMs = Math.min(1000, Math.max(40, 0.8 * this.gapMs + 0.2 * (nowMs - this.takenMs)));
    this.before = new Map([...this.cars.keys()].map((vehicle) => [vehicle, this.distanceOf(vehicle, nowMs)]));
    this.takenMs = nowMs;
    this.frame = frame;
    this.list = frame.cars.map((row) => Object.fromEntries(CAR.map((name, k) => [name, row[k]])));
    this.cars = new Map(this.list.map((car) => [car.vehicle, car]));
    this.remember(frame);
  }

  remember({ time_s, elapsed_ms, missed_total, crossed_total, in_zone_total_s }) {
    let [waiting, standing] = [0, 0];
    for (const car of this.list) {
      waiting += car.status === "waiting" || car.status === "offered";
      standing += car.speed_mps < 0.5;
      if (car.price > 0) this.paid.set(car.vehicle, car.price);
      const trail = this.trails.get(car.vehicle) ?? [];
      trail.push([time_s, car.speed_mps]);
      if (trail[0][0] < time_s - TRAIL_S) trail.shift();
      this.trails.set(car.vehicle, trail);
    }
    for (const vehicle of this.trails.keys()) {
      if (this.cars.has(vehicle)) continue;
      this.trails.delete(vehicle);
      this.paid.delete(vehicle);
    }
    this.history.push({ time_s, elapsed_ms, missed_total, crossed_total, in_zone_total_s, waiting, standing });
    while (this.history[0].time_s < time_s - HISTORY_S) this.history.shift();
  }

  // Between frames a vehicle goes on evenly from where it was drawn to where the newest frame has it.
  distanceOf(vehicle, nowMs) {
    const car = this.cars.get(vehicle);
    const from = this.before.get(vehicle);
    if (from === undefined) return car.distance_m;
    const share = Math.min(MOST_AHEAD, (nowMs - this.takenMs) / this.gapMs);
    return from + share * (car.distance_m - from);
  }

  inOrder() {
    const ranked = this.list.filter((car) => car.rank >= 0 && car.status !== "leaving");
    return ranked.sort((one, other) => one.rank - other.rank);
  }

  // By how much a total has grown over the last `span_s`, and over how long that really is.
  grown(name, span_s) {
    const last = this.history[this.history.length - 1];
    const first = this.history.find((past) => past.time_s >= last.time_s - span_s);
    return [last[name] - first[name], last.time_s - first.time_s];
  }
}

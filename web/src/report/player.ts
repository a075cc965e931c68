/** The clock of the report: play, slow motion, scrub. */

const SLOW = 0.125;
const PAUSE_AT_END_S = 0.8; // [s] before it begins again

export class Player {
  private readonly bar = document.createElement("input");
  private readonly clock = document.createElement("output");
  private readonly buttons = new Map<number, HTMLButtonElement>();
  private readonly listeners: ((time_s: number) => void)[] = [];
  private speed = 0; // 0: standing
  private last = 0;
  private time = 0;

  constructor(
    host: HTMLElement,
    readonly end: number,
    readonly release: number,
  ) {
    const row = document.createElement("div");
    row.className = "player";
    for (const [speed, text] of [
      [1, "Play"],
      [SLOW, "Slow"],
    ] as const) {
      const made = document.createElement("button");
      Object.assign(made, { type: "button", textContent: text });
      made.addEventListener("click", () => this.play(this.speed === speed ? 0 : speed));
      this.buttons.set(speed, made);
    }
    Object.assign(this.bar, { type: "range", min: "0", max: String(end), step: "0.001" });
    this.bar.setAttribute("aria-label", "Time [s]");
    this.bar.addEventListener("input", () => {
      this.play(0);
      this.go(Number(this.bar.value));
    });
    const mark = document.createElement("button");
    Object.assign(mark, { type: "button", textContent: "Release" });
    mark.addEventListener("click", () => this.go(release));
    row.append(...this.buttons.values(), mark, this.bar, this.clock);
    host.append(row);
  }

  onTime(listener: (time_s: number) => void): void {
    this.listeners.push(listener);
  }

  /** Goes to an instant [s]. */
  go(time_s: number): void {
    this.time = Math.min(Math.max(time_s, 0), this.end);
    this.bar.value = String(this.time);
    this.clock.textContent = `${this.time.toFixed(3)} s`;
    for (const listener of this.listeners) listener(this.time);
  }

  private play(speed: number): void {
    this.speed = speed;
    for (const [own, made] of this.buttons) made.setAttribute("aria-pressed", String(own === speed));
    if (speed && this.time >= this.end) this.go(0);
    this.last = performance.now();
    if (speed) requestAnimationFrame((now) => this.step(now));
  }

  private step(now: number): void {
    if (!this.speed) return;
    const passed = (Math.max(0, now - this.last) / 1000) * this.speed;
    this.last = now;
    if (this.time + passed >= this.end + PAUSE_AT_END_S * this.speed) this.go(0);
    else if (this.time < this.end) this.go(this.time + passed);
    else this.time += passed; // stands at the end for a moment
    requestAnimationFrame((next) => this.step(next));
  }
}

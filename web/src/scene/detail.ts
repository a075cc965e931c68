/**
 * How much detail the machine can draw while things move. Frames are timed one after another; where they are slow,
 * resolution falls, then shadows go. A picture at rest is drawn once more in full.
 */

/** What is left out at each level; level 0 has everything. */
interface Detail {
  readonly resolution: number; // as a share of the screen's own
  readonly shadow: boolean;
  readonly fine: boolean; // meshes for close looks
}

export const LEVELS: readonly Detail[] = [
  { resolution: 1, shadow: true, fine: true },
  { resolution: 0.8, shadow: true, fine: false },
  { resolution: 0.65, shadow: false, fine: false },
  { resolution: 0.5, shadow: false, fine: false },
  { resolution: 0.36, shadow: false, fine: false },
];

/** Where a machine without a graphics processor begins: each step down to it would draw everything anew. */
export const SOFTWARE_LEVEL = 2;

const SLOW_MS = 31; // [ms] a frame: below 32 frames a second something goes
const FAST_MS = 15; // [ms] a frame: above 66 frames a second something comes back
const SLOW_FRAMES = 4; // in a row until it goes
const FAST_FRAMES = 45; // in a row until it comes back
const PAUSE_MS = 2000; // [ms] a longer gap is a pause, not a slow frame

/** Chooses the level from the times between frames. */
export class DetailControl {
  private last = Number.NaN;
  private slow = 0;
  private fast = 0;
  private patience = FAST_FRAMES;

  constructor(public level = 0) {}

  /** Takes note of a frame at `now` [ms] while things move; returns whether the level has changed. */
  frame(now: number): boolean {
    const duration = now - this.last;
    this.last = now;
    if (!(duration < PAUSE_MS)) return false;
    this.slow = duration > SLOW_MS ? this.slow + 1 : 0;
    this.fast = duration < FAST_MS ? this.fast + 1 : 0;
    if (this.slow >= SLOW_FRAMES) return this.change(1);
    return this.fast >= this.patience && this.change(-1);
  }

  /** Says that nothing moves any more: the next frame begins a new row. */
  pause(): void {
    this.last = Number.NaN;
    this.slow = this.fast = 0;
  }

  private change(by: 1 | -1): boolean {
    const level = Math.min(Math.max(this.level + by, 0), LEVELS.length - 1);
    const changed = level !== this.level;
    if (by === 1) this.patience = Math.min(2 * this.patience, 60 * FAST_FRAMES); // what was too much is not soon tried again
    this.slow = this.fast = 0;
    this.level = level;
    return changed;
  }
}

// Measures how fast frames come. No renderer's name says that: a slow machine may have a GPU, a fast one none.

// Slower than this is slow with WebGL and canvases of the GPU, and with those of the CPU [ms a frame].
export const SLOW = 40;
export const SLOW_SOFTWARE = 50;
// A judgement needs this much time [ms] and this many frames: one long frame is no slow machine.
const LEAST_TIME = 1500;
const LEAST_FRAMES = 5;

export class Pace {
  most = SLOW;
  private last = NaN;
  private sum = 0;
  private readonly times: number[] = [];

  reset(): void {
    this.last = NaN;
    this.sum = 0;
    this.times.length = 0;
  }

  // Takes the time of a frame [ms]. Returns true if half of the frames since the last judgement took longer than `most`.
  slow(now: number): boolean {
    const passed = now - this.last;
    this.last = now;
    if (!(passed > 0)) return false;
    this.times.push(passed);
    this.sum += passed;
    if (this.sum < LEAST_TIME || this.times.length < LEAST_FRAMES) return false;
    const sorted = this.times.sort((a, b) => a - b);
    const median = sorted[sorted.length >> 1]!;
    this.sum = 0;
    this.times.length = 0;
    return median > this.most;
  }
}

// The page's sign of life: when the worker sends a ping, and when it gives a silent server up.

// The server counts a page with control as lost after 2 s without a message. The worker speaks for the main thread only
// as long as that ran within this time: a page whose main thread hangs cannot take a Stop, so it must be counted as lost [s].
export const MAIN_PATIENCE = 2;
export const PING_EVERY = 0.5; // [s]
// Without a word of the server for this long the connection counts as lost [s]: a live server sends its status at 4 Hz.
export const SERVER_PATIENCE = 3;

export class SignOfLife {
  private main = -Infinity;
  private server = -Infinity;

  // The main thread ran at `now` [s].
  mainRan(now: number): void {
    this.main = now;
  }

  // A message of the server came at `now` [s], or its connection was opened.
  serverSpoke(now: number): void {
    this.server = now;
  }

  // Returns true if a ping may be sent at `now` [s].
  pings(now: number): boolean {
    return now - this.main <= MAIN_PATIENCE;
  }

  // Returns true if the server has been silent for too long at `now` [s].
  serverLost(now: number): boolean {
    return now - this.server > SERVER_PATIENCE;
  }
}

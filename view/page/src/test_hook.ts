// Lets a test in a real browser compare what the page shows with the file. Only with "&test" after the token.
import type { Shell } from "./shell";

interface TestHook {
  // Script time of each frame [ms], newest last.
  times(): number[];
  resetTimes(): void;
  frames(): number;
  shown(): { time: number; rowTime: number; values: Record<string, number> };
  lanes(): { name: string; value: number; text: string }[];
  drawn(column: string): { t: number; width: number; min: number; max: number }[];
  window(): { t0: number; t1: number };
  // Place of the tool in the window [CSS px]; null if it is not known.
  tool(): { x: number; y: number } | null;
  // Places of the path's points in the window [CSS px], in order.
  path(): { x: number; y: number }[];
  state(): Record<string, unknown>;
  // Codes of the warnings and notes that came.
  warnings(): string[];
  seek(time: number): void;
  play(speed?: number): void;
  pause(): void;
  span(seconds: number): void;
  // Draws one frame now, whatever the display's rate.
  frame(): void;
}

export function installTestHook(shell: Shell): void {
  const m = shell.model;
  const hook: TestHook = {
    times: () => shell.times.slice(),
    resetTimes: () => void (shell.times.length = 0),
    frames: () => shell.frames,
    shown: () => ({
      time: m.shown,
      rowTime: m.shownRowTime,
      values: Object.fromEntries((m.recording?.columns ?? []).map((c) => [c.name, m.value(c.name)])),
    }),
    lanes: () => shell.lanes?.shownValues() ?? [],
    drawn: (column) => shell.lanes?.drawnBins(column) ?? [],
    window: () => ({ ...(shell.lanes?.window ?? { t0: NaN, t1: NaN }) }),
    tool: () => shell.scene?.place(m.value("x"), m.value("y"), m.value("z")) ?? null,
    path: () => {
      const line = shell.scene?.picture.path;
      if (line === undefined) return [];
      const places = Array.from({ length: line.count }, (_, i) =>
        shell.scene!.place(line.xyz[3 * i]!, line.xyz[3 * i + 1]!, line.xyz[3 * i + 2]!),
      );
      return places.filter((place) => place !== null);
    },
    state: () => ({
      connected: m.connected,
      refused: m.refused,
      live: m.live,
      following: m.following,
      playing: m.playing,
      lag: m.lag,
      software: shell.software,
      flat: shell.flat,
      painter: shell.scene?.painter.kind ?? "",
      holding: shell.holding,
      renderer: shell.rendererName,
      start: m.start,
      end: m.end,
      // Session time of the newest status [s].
      told: m.status?.time ?? NaN,
      ended: m.status?.ended ?? false,
      zeroForce: m.status?.zero_force ?? "",
      repetitions: m.repetitions.length,
      events: m.events.length,
      ringRows: m.ring.end,
      blocks: m.blocks.size,
      lostRows: m.lostRows,
      roundTrip: shell.client.roundTrip,
      path: m.path?.count ?? 0,
      movement: m.movement?.count ?? 0,
    }),
    warnings: () => m.warnings.map((w) => w.code),
    seek: (time) => m.seek(time),
    play: (speed) => {
      if (speed !== undefined) m.setSpeed(speed);
      m.play();
    },
    pause: () => m.pause(),
    span: (seconds) => shell.lanes?.setSpan(seconds),
    frame: () => shell.draw(performance.now(), true),
  };
  (window as unknown as { haptraceTest: TestHook }).haptraceTest = hook;
}

// Short tones of the training screen. A browser plays nothing before a click: `open` is called by one.

export type SoundName = "go" | "done" | "stopped" | "lost" | "tick";

interface Tone {
  frequency: number; // [Hz]
  start: number; // [s]
  length: number; // [s]
}

const TONES: Record<SoundName, readonly Tone[]> = {
  go: [{ frequency: 880, start: 0, length: 0.15 }],
  done: [
    { frequency: 660, start: 0, length: 0.12 },
    { frequency: 880, start: 0.14, length: 0.16 },
  ],
  stopped: [{ frequency: 220, start: 0, length: 0.4 }],
  lost: [{ frequency: 220, start: 0, length: 0.4 }],
  tick: [{ frequency: 440, start: 0, length: 0.05 }],
};

const LOUDNESS = 0.25;
// Rise and fall of a tone [s]: without them a loudspeaker clicks.
const EDGE = 0.012;

export class Sounds {
  private context: AudioContext | null = null;

  // Opens the sound. Must be called by a click or a key; returns false if the browser has no sound.
  open(): boolean {
    if (typeof AudioContext === "undefined") return false;
    this.context ??= new AudioContext();
    if (this.context.state === "suspended") void this.context.resume().catch(() => undefined);
    return true;
  }

  play(name: SoundName): void {
    const context = this.context;
    if (context === null || context.state !== "running") return;
    for (const tone of TONES[name]) {
      const start = context.currentTime + tone.start;
      const end = start + tone.length;
      const source = context.createOscillator();
      const loudness = context.createGain();
      source.frequency.value = tone.frequency;
      loudness.gain.setValueAtTime(0, start);
      loudness.gain.linearRampToValueAtTime(LOUDNESS, start + EDGE);
      loudness.gain.setValueAtTime(LOUDNESS, end - EDGE);
      loudness.gain.linearRampToValueAtTime(0, end);
      source.connect(loudness).connect(context.destination);
      source.start(start);
      source.stop(end);
      source.onended = () => loudness.disconnect();
    }
  }

  close(): void {
    void this.context?.close().catch(() => undefined);
    this.context = null;
  }
}

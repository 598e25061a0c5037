// The connection to the server: one WebSocket in a worker, the token, reconnection, the clock, requests with their answers.
import type { Model } from "./model";
import {
  decodeFrame,
  encodeIntention,
  FLAG_BACKFILL,
  Kind,
  parseText,
  PROTOCOL_VERSION,
  type BinsFrame,
  type Frame,
  type Intention,
  type PageMessage,
  type RowsFrame,
  type Want,
} from "./protocol";
import { Wire } from "./wire";

const TOKEN_KEY = "haptrace-token";
const TEST_KEY = "haptrace-test";
const RECONNECT_FIRST = 0.25; // [s]
const RECONNECT_MOST = 5; // [s]
const REQUEST_TIMEOUT = 10; // [s]
const STOP_KEPT = 10000; // age of a Stop that is still sent when the connection is back [ms]

// Reads "#TOKEN", or "#TOKEN&test", which asks for the test hook too. A token has 16 to 128 letters and digits, which is the
// rule of the server. Returns null for others.
export function readToken(hash: string): { token: string; test: boolean } | null {
  const found = /^#([0-9a-zA-Z]{16,128})(&test)?$/.exec(hash);
  return found === null ? null : { token: found[1]!, test: found[2] !== undefined };
}

// Takes the token out of the address and keeps it in the tab, so that a reload works and no history has it.
export function takeToken(): { token: string; test: boolean } {
  const found = readToken(location.hash);
  if (found !== null) {
    sessionStorage.setItem(TOKEN_KEY, found.token);
    sessionStorage.setItem(TEST_KEY, found.test ? "on" : "off");
    history.replaceState(null, "", location.pathname);
  }
  return { token: sessionStorage.getItem(TOKEN_KEY) ?? "", test: sessionStorage.getItem(TEST_KEY) === "on" };
}

interface Waiting {
  resolve: (value: unknown) => void;
  timer: number;
}

// Estimates session time minus page time from arrivals. Rows that come late are late by the network, never early, so the
// largest difference is the best one; it decays slowly, since two clocks drift.
export class ClockOffset {
  value = NaN;
  private at = NaN;

  // `session` and `now` in s. `now` is the page's clock when the row arrived.
  add(session: number, now: number): void {
    const offset = session - now;
    if (!Number.isFinite(this.value) || Math.abs(offset - this.value) > 1) {
      this.value = offset;
    } else {
      const decayed = this.value - 0.001 * Math.max(0, now - this.at);
      this.value = Math.max(decayed, offset);
    }
    this.at = now;
  }

  reset(): void {
    this.value = NaN;
  }
}

export class Client {
  // Round trip of the last ping [s]; NaN before the first.
  roundTrip = NaN;
  private readonly model: Model;
  private readonly token: string;
  private readonly wire: Wire;
  // The socket is open or being opened.
  private connecting = false;
  private wanted: Want = "samples";
  private nextId = 1;
  private binary = 0;
  private wait = RECONNECT_FIRST;
  private readonly waiting = new Map<number, Waiting>();
  private closed = false;
  private readonly clock = new ClockOffset();
  private unsentStop = NaN;

  constructor(model: Model, token: string) {
    this.model = model;
    this.token = token;
    this.wire = new Wire({
      open: () => this.greet(),
      message: (data) => {
        if (typeof data === "string") this.takeText(data);
        else this.takeFrame(data);
      },
      closed: (code, reason) => this.lost(code, reason),
    });
    model.setSource(this);
  }

  start(): void {
    this.connect();
    window.addEventListener("online", () => {
      if (!this.connecting && !this.closed) this.connect();
    });
  }

  get ready(): boolean {
    return this.wire.ready;
  }

  // Sends a text message. Returns false if there is no connection.
  send(message: PageMessage): boolean {
    if (!this.ready) return false;
    this.wire.send(JSON.stringify(message));
    return true;
  }

  // Asks for zero force now. Waits for nothing. Returns false if there is no connection.
  stop(): boolean {
    const sent = this.send({ type: "stop" });
    this.unsentStop = sent || this.model.over ? NaN : performance.now();
    return sent;
  }

  // The last Stop found no connection. When one comes back, the page sends it, if it is not too old.
  get stopWaits(): boolean {
    return Number.isFinite(this.unsentStop);
  }

  want(data: Want): void {
    this.wanted = data;
    if (this.model.hello?.live === true) this.send({ type: "want", data });
  }

  // Sends one line as in docs/tuning.md. Returns the answer: "ok ..." or "error ...".
  async command(line: string): Promise<string> {
    const id = this.nextId++;
    const answer = this.answerOf(id);
    if (!this.send({ type: "command", id, line })) {
      this.settle(id, null);
      return "error: no connection";
    }
    const text = await answer;
    return typeof text === "string" ? text : "error: no answer";
  }

  open(recording: number): void {
    this.send({ type: "open", id: this.nextId++, recording });
  }

  // Reports the frame that showed "go" or "done". `frame` counts the page's frames; `time` is the newest row drawn [s].
  shown(what: "go" | "done", trial: number, frame: number, time: number): void {
    this.send({ type: "shown", what, trial, frame, time });
  }

  // Sends the intention of the hand. The caller keeps the rate: at most one each 8 ms, at least one each 0.1 s while held.
  intention(intention: Intention): boolean {
    if (!this.ready) return false;
    this.wire.send(encodeIntention(intention, this.binary++));
    return true;
  }

  async requestBins(t0: number, t1: number, pixels: number, channels: string[]): Promise<BinsFrame | null> {
    const id = this.nextId++;
    const answer = this.answerOf(id);
    if (!this.send({ type: "bins", id, t0, t1, pixels, channels })) this.settle(id, null);
    const frame = (await answer) as Frame | null;
    return frame !== null && frame.kind === Kind.bins && frame.channels.length === channels.length ? frame : null;
  }

  async requestRows(t0: number, t1: number): Promise<RowsFrame | null> {
    const id = this.nextId++;
    const answer = this.answerOf(id);
    if (!this.send({ type: "rows", id, t0, t1 })) this.settle(id, null);
    const frame = (await answer) as Frame | null;
    return frame !== null && frame.kind === Kind.samples ? frame : null;
  }

  // Returns the session's time now [s]; NaN until known.
  sessionNow(): number {
    return performance.now() / 1000 + this.clock.value;
  }

  private answerOf(id: number): Promise<unknown> {
    return new Promise((resolve) => {
      const timer = window.setTimeout(() => this.settle(id, null), 1000 * REQUEST_TIMEOUT);
      this.waiting.set(id, { resolve, timer });
    });
  }

  private settle(id: number, value: unknown): void {
    const entry = this.waiting.get(id);
    if (entry === undefined) return;
    this.waiting.delete(id);
    window.clearTimeout(entry.timer);
    entry.resolve(value);
  }

  private connect(): void {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.connecting = true;
    this.wire.open(`${scheme}://${location.host}/ws`);
  }

  private greet(): void {
    const last = this.model.ring.newest;
    this.binary = 0;
    this.send(Number.isFinite(last) ? { type: "hello", version: PROTOCOL_VERSION, token: this.token, last } : { type: "hello", version: PROTOCOL_VERSION, token: this.token });
  }

  private lost(code: number, reason: string): void {
    this.connecting = false;
    this.clock.reset();
    for (const id of [...this.waiting.keys()]) this.settle(id, null);
    // After the end of a session the server is gone; an address that is kept may have another one soon.
    const over = code === 1001 || (this.model.refused === "over" && code === 1006);
    const refused = code === 1008;
    if (refused) this.closed = true;
    this.model.setConnected(false, refused ? reason || "The server refused this page" : over ? "over" : "");
    if (this.closed) return;
    window.setTimeout(() => {
      if (!this.connecting && !this.closed) this.connect();
    }, 1000 * this.wait);
    this.wait = Math.min(RECONNECT_MOST, 2 * this.wait);
  }

  private takeText(text: string): void {
    const message = parseText(text);
    if (message === null) return;
    switch (message.type) {
      case "hello":
        this.wait = RECONNECT_FIRST;
        this.model.take(message);
        if (performance.now() - this.unsentStop > STOP_KEPT) this.unsentStop = NaN;
        this.model.setConnected(true);
        if (message.live) this.send({ type: "want", data: this.wanted });
        break;
      case "answer":
        this.settle(message.id, message.text);
        break;
      case "error":
        // A request without an answer is asked again; no person needs to know.
        if (message.id !== undefined && message.id !== 0 && this.waiting.has(message.id)) {
          this.settle(message.id, null);
          break;
        }
        this.model.take({ type: "warning", severity: "warning", code: "page", time: null, text: message.text });
        break;
      case "pong":
        this.roundTrip = (performance.timeOrigin + performance.now()) / 1000 - message.sent;
        break;
      default:
        this.model.take(message);
    }
  }

  private takeFrame(buffer: ArrayBuffer): void {
    const frame = decodeFrame(buffer);
    if (frame === null) return;
    const header = frame.header;
    if (frame.kind === Kind.path) {
      this.model.takePath(frame);
    } else if (frame.kind === Kind.mesh) {
      this.model.takeMesh(frame);
    } else if (header.request !== 0) {
      this.settle(header.request, frame);
    } else if (frame.kind !== Kind.bins) {
      if ((header.flags & FLAG_BACKFILL) === 0 && frame.time.length > 0) {
        const newest = header.t0 + frame.time[frame.time.length - 1]!;
        this.clock.add(newest, performance.now() / 1000);
        this.model.clockOffset = this.clock.value;
      }
      this.model.takeRows(frame);
    }
  }
}
